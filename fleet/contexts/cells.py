"""The content of an autonomy cube in memory, and what may be wrong with it."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Media
from fleet.contexts.manifest import CubeManifest, GridSpec, PictureKind
from fleet.errors import Problem

MAX_RENDERED_EXG = 400.0
"""Pictures of 8 bits a channel have no room for more."""


@dataclass(frozen=True, eq=False)
class Cells:
    """Measured features: one entry a cell and date.

    Args:
        rows, columns: Cell of each entry, int64 [n].
        dates: Date of each entry, text [n].
        features: Values by name, float64 [n] each; NaN where nothing was measured.
    """

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    dates: NDArray[np.str_]
    features: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.rows)


@dataclass(frozen=True, eq=False)
class Pictures:
    """Stored pictures: any number a cell and date, in the order in which they were taken.

    Args:
        rows, columns: Cell of each picture, int64 [n].
        dates: Date of each picture, text [n].
        media: The pictures.
    """

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    dates: NDArray[np.str_]
    media: tuple[Media, ...]

    def __len__(self) -> int:
        return len(self.media)


@dataclass(frozen=True, eq=False)
class CubeContent:
    """Everything that an autonomy cube holds."""

    manifest: CubeManifest
    cells: Cells
    pictures: Pictures | None = None

    def digest(self) -> str:
        """Hash of the content, 32 hex digits; the same for the same content however it is encoded or ordered."""
        digest = hashlib.blake2b(self.manifest.model_dump_json(by_alias=True).encode(), digest_size=16)
        for part in _canonical(self):
            digest.update(len(part).to_bytes(8, "little") + part)
        return digest.hexdigest()


@dataclass(frozen=True)
class Findings:
    """What was found in a context: problems make it unusable, warnings do not."""

    problems: tuple[Problem, ...] = ()
    warnings: tuple[Problem, ...] = ()


def examine(content: CubeContent) -> Findings:
    """Look for everything that is wrong with a cube's content."""
    return Findings(tuple(_problems(content)), tuple(_warnings(content)))


def _canonical(content: CubeContent) -> Iterator[bytes]:
    cells = content.cells
    order = np.lexsort((cells.columns, cells.rows, cells.dates))
    yield from _keys(cells, order)
    for name in sorted(cells.features):
        values = cells.features[name][order].astype("<f8") + 0.0  # -0.0 is 0.0
        yield name.encode()
        yield np.where(np.isnan(values), np.nan, values).astype("<f8").tobytes()
    if content.pictures is not None:
        order = np.lexsort((content.pictures.columns, content.pictures.rows, content.pictures.dates))
        yield from _keys(content.pictures, order)
        for index in order:
            media = content.pictures.media[index]
            yield media.type.encode()
            yield hashlib.blake2b(media.data, digest_size=16).digest()


def _keys(table: Cells | Pictures, order: NDArray[np.int64]) -> Iterator[bytes]:
    yield table.rows[order].astype("<i8").tobytes()
    yield table.columns[order].astype("<i8").tobytes()
    yield "\n".join(table.dates[order].tolist()).encode()


def _problems(content: CubeContent) -> Iterator[Problem]:
    manifest, cells = content.manifest, content.cells
    yield from _misplaced(cells, manifest, "features.parquet")
    yield from _repeated(cells)
    for name, values in cells.features.items():
        infinite = np.flatnonzero(np.isinf(values))
        if len(infinite):
            yield Problem(name, f"is infinite in {_where(cells, infinite)}", "leave the value out where it is unknown")
    if not np.any(has_data(content)):
        quantity = f"a value of {manifest.truth}" if manifest.truth else "a picture"
        yield Problem("", f"no cell has {quantity}", "a context needs at least one cell with data")
    yield from _picture_problems(content)


def _misplaced(table: Cells | Pictures, manifest: CubeManifest, file: str) -> Iterator[Problem]:
    grid = manifest.grid
    for name, numbers, count in (("row", table.rows, grid.rows), ("column", table.columns, grid.columns)):
        outside = np.flatnonzero((numbers < 0) | (numbers >= count))
        if len(outside):
            hint = f"the grid of context.yaml has {name}s 0 to {count - 1}"
            yield Problem(f"{file}.{name}", f"is outside of the grid in {_where(table, outside)}", hint)
    unknown = sorted(set(table.dates.tolist()) - set(manifest.dates))
    if unknown:
        yield Problem(f"{file}.date", f"has {', '.join(unknown[:5])}", "list every date under dates in context.yaml")


def _repeated(cells: Cells) -> Iterator[Problem]:
    order = np.lexsort((cells.columns, cells.rows, cells.dates))
    rows, columns, dates = cells.rows[order], cells.columns[order], cells.dates[order]
    same = (rows[1:] == rows[:-1]) & (columns[1:] == columns[:-1]) & (dates[1:] == dates[:-1])
    repeated = order[1:][same]
    if len(repeated):
        hint = "keep one entry a cell and date; `fleet context import` averages them"
        yield Problem("features.parquet", f"has more than one entry for {_where(cells, repeated)}", hint)


def _picture_problems(content: CubeContent) -> Iterator[Problem]:
    manifest, pictures = content.manifest, content.pictures
    if pictures is not None:
        yield from _misplaced(pictures, manifest, "pictures.parquet")
        empty = np.array([i for i, media in enumerate(pictures.media) if not media.data], dtype=np.int64)
        if len(empty):
            yield Problem("pictures.parquet.data", f"is empty in {_where(pictures, empty)}", "leave such rows out")
    if manifest.pictures is PictureKind.STORED and pictures is None:
        yield Problem("pictures.parquet", "is missing", "add it, or write pictures: Rendered in context.yaml")
    if manifest.pictures is PictureKind.RENDERED and manifest.pictured is None:
        hint = "add a feature `exg`, or write render: {feature: ..., low: 0, high: ...} in context.yaml"
        yield Problem("render", "nothing says what rendered pictures show", hint)
    yield from _unrenderable(content)


def _unrenderable(content: CubeContent) -> Iterator[Problem]:
    manifest, exg = content.manifest, pictured_exg(content)
    bare = has_data(content) & ~_has_picture(content)
    lacking = np.flatnonzero(bare & ~np.isfinite(exg))
    said_already = manifest.pictures is PictureKind.RENDERED and manifest.pictured is None
    if len(lacking) and not said_already:
        hint = "add a picture, or the feature that pictures show, or leave the cell out"
        yield Problem("pictures", f"there is none and none can be rendered in {_where(content.cells, lacking)}", hint)
    loud = np.flatnonzero(bare & (np.abs(exg) > MAX_RENDERED_EXG))
    if len(loud):
        hint = f"pictures show excess green from -{MAX_RENDERED_EXG:.0f} to {MAX_RENDERED_EXG:.0f}; use another scale"
        yield Problem("render", f"the picture cannot show the value in {_where(content.cells, loud)}", hint)


def _warnings(content: CubeContent) -> Iterator[Problem]:
    manifest, cells = content.manifest, content.cells
    for name, values in cells.features.items():
        missing = int(np.count_nonzero(np.isnan(values)))
        if missing:
            consequence = "these cells count as cells without data" if name == manifest.truth else ""
            yield Problem(name, f"is missing in {missing} of {len(cells)} entries", consequence)
    for date in manifest.dates:
        if not np.any(cells.dates == date):
            yield Problem("dates", f"nothing was observed on {date}")
    for name in ("source", "licence"):
        if not getattr(manifest, name):
            yield Problem(name, "is not stated in context.yaml")
    if manifest.truth is None:
        yield Problem("truth", "is not stated in context.yaml", "missions over it have no accuracy")


def has_data(content: CubeContent) -> NDArray[np.bool_]:
    """Which entries of the cells are states with data: the truth is known, or without a truth, there is a picture."""
    if content.manifest.truth is not None:
        return np.isfinite(content.cells.features[content.manifest.truth])
    if content.manifest.pictures is PictureKind.STORED:
        return _has_picture(content)
    return np.isfinite(pictured_exg(content))


def pictured_exg(content: CubeContent) -> NDArray[np.float64]:
    """Excess green that a rendered picture of each entry shows, [n]; NaN where nothing can be rendered."""
    manifest = content.manifest
    if manifest.pictured is None:
        return np.full(len(content.cells), np.nan)
    values = content.cells.features[manifest.pictured]
    if manifest.render is None:
        return values
    return (values - manifest.render.low) * manifest.render.exg_per_unit


def _has_picture(content: CubeContent) -> NDArray[np.bool_]:
    if content.pictures is None:
        return np.zeros(len(content.cells), dtype=np.bool_)
    pictured = set(_positions(content.pictures))
    return np.array([position in pictured for position in _positions(content.cells)], dtype=np.bool_)


def _positions(table: Cells | Pictures) -> Iterator[tuple[str, int, int]]:
    return zip(table.dates.tolist(), table.rows.tolist(), table.columns.tolist(), strict=True)


def _where(table: Cells | Pictures, entries: NDArray[np.int64]) -> str:
    """The first few of some entries, for a message."""
    named = [
        f"row {table.rows[i]}, column {table.columns[i]} ({table.dates[i]})" for i in entries[:3].tolist()
    ]  # fmt: skip
    more = f" and {len(entries) - 3} more" if len(entries) > 3 else ""
    return "; ".join(named) + more


def grid_of(
    values: NDArray[np.float64], rows: NDArray[np.int64], columns: NDArray[np.int64], grid: GridSpec
) -> NDArray[np.float64]:
    """Entries laid out on the grid, [rows, columns], NaN where there is none."""
    laid = np.full((grid.rows, grid.columns), np.nan)
    laid[rows, columns] = values
    return laid

"""From located values to an autonomy cube: averages of each cell, the grid, the manifest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from fleet.contexts.cells import Cells, CubeContent, Pictures, examine
from fleet.contexts.importing.columns import describe
from fleet.contexts.importing.options import ImportOptions
from fleet.contexts.importing.sheet import VERDICT
from fleet.contexts.manifest import (
    BrokenContext,
    CubeManifest,
    FeatureSpec,
    GridSpec,
    PictureKind,
    RenderScale,
    problems_of,
)

EARTH_M_PER_DEGREE = 111_194.93
"""Length of a degree of latitude on a sphere of 6371 km."""


@dataclass(frozen=True)
class Orientation:
    """Size of cells and which way rows and columns grow."""

    cell_height_m: float
    cell_width_m: float
    rows_go_south: bool = True
    columns_go_east: bool = True


@dataclass(frozen=True, eq=False)
class Located:
    """Values with their cell and date: what every import comes down to.

    Args:
        rows, columns: int64 [n].
        dates: Text [n].
        features: float64 [n] by name.
        orientation: Of the grid.
        truth: The feature that missions map; None when none is known.
        pictures: Stored pictures, when there are any.
        described: What the source says of its features; the others are described by their names.
    """

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    dates: NDArray[np.str_]
    features: Mapping[str, NDArray[np.float64]]
    orientation: Orientation
    truth: str | None
    pictures: Pictures | None = None
    described: Mapping[str, FeatureSpec] | None = None


def assemble(located: Located, options: ImportOptions, where: str) -> CubeContent:
    """Average what is in a cell on a date, and make it a cube.

    Raises:
        BrokenContext: it would not be a good context.
    """
    cells = average(located)
    try:
        manifest = _manifest(located, cells, options)
    except ValidationError as error:
        raise BrokenContext(where, problems_of(error), VERDICT) from error
    content = CubeContent(manifest, cells, located.pictures)
    problems = list(examine(content).problems)
    if problems:
        raise BrokenContext(where, problems, VERDICT)
    return content


def average(located: Located) -> Cells:
    """One entry a cell and date, in the order of date, row and column: the mean of each feature where it is known."""
    dates, date_of = np.unique(located.dates, return_inverse=True)
    keys = np.stack([date_of.ravel(), located.rows, located.columns])
    unique, entry_of = np.unique(keys, axis=1, return_inverse=True)
    entry_of, entries = entry_of.ravel(), unique.shape[1]
    features = {}
    for name, values in located.features.items():
        known = np.isfinite(values)
        counts = np.bincount(entry_of[known], minlength=entries)
        sums = np.bincount(entry_of[known], weights=values[known], minlength=entries)
        means = np.divide(sums, counts, out=np.full(entries, np.nan), where=counts > 0)
        features[name] = means
    return Cells(unique[1], unique[2], dates[unique[0]], features)


def metres(lat: NDArray[np.float64], lon: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions in degrees as metres to the north and to the east of the most south-western of them.

    An equirectangular projection about the mean latitude: good to a metre over the length of a field.
    """
    north = (lat - lat.min()) * EARTH_M_PER_DEGREE
    east = (lon - lon.min()) * EARTH_M_PER_DEGREE * math.cos(math.radians(float(lat.mean())))
    return north, east


def _manifest(located: Located, cells: Cells, options: ImportOptions) -> CubeManifest:
    orientation = located.orientation
    described = {**{name: describe(name) for name in cells.features}, **(located.described or {})}
    stored = located.pictures is not None
    return CubeManifest(
        name=options.name,
        description=options.description,
        source=options.source,
        licence=options.licence,
        dates=tuple(sorted(set(cells.dates.tolist()))),
        grid=GridSpec(
            rows=options.rows or int(cells.rows.max()) + 1,
            columns=options.columns or int(cells.columns.max()) + 1,
            cell_height_m=orientation.cell_height_m,
            cell_width_m=orientation.cell_width_m,
            rows_go_south=orientation.rows_go_south,
            columns_go_east=orientation.columns_go_east,
        ),
        truth=located.truth,
        features=tuple(described[name] for name in cells.features),
        pictures=PictureKind.STORED if stored else PictureKind.RENDERED,
        render=None if stored or "exg" in cells.features else _scale(located.truth, cells),
    )


def _scale(truth: str | None, cells: Cells) -> RenderScale | None:
    """A scale from 0 to the largest value, so that classes relative to the mean stay what they are."""
    if truth is None:
        return None
    known = cells.features[truth][np.isfinite(cells.features[truth])]
    largest = float(np.abs(known).max()) if len(known) else 1.0
    return RenderScale(feature=truth, low=0.0, high=_rounded_up(largest) if largest > 0 else 1.0)


def _rounded_up(value: float) -> float:
    """To two significant digits."""
    exponent = math.floor(math.log10(value)) - 1
    return float(f"{math.ceil(value / 10.0**exponent) * 10.0**exponent:.6g}")

"""Small autonomy cubes for tests, made as a user would make them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Media
from fleet.contexts.cells import Cells, CubeContent, Pictures
from fleet.contexts.manifest import CubeManifest, FeatureSpec, GridSpec, PictureKind, RenderScale
from fleet.errors import ObjectNotFound
from fleet.storage.port import Entry

DATE = "2018-06-01"
PIXEL = Media("image/x-portable-pixmap", b"P6\n1 1\n255\n\x10\x80\x20")


def manifest(  # noqa: PLR0917 - every field has a default, and tests name what they change
    features: Sequence[str] = ("exg",),
    rows: int = 3,
    columns: int = 4,
    dates: Sequence[str] = (DATE,),
    truth: str | None = "exg",
    pictures: PictureKind = PictureKind.RENDERED,
    render: RenderScale | None = None,
) -> CubeManifest:
    return CubeManifest(
        name="plot",
        source="tests",
        licence="Apache-2.0",
        dates=tuple(dates),
        grid=GridSpec(rows=rows, columns=columns, cell_height_m=10.0, cell_width_m=8.0),
        truth=truth,
        features=tuple(FeatureSpec(name=name, attribute=name in {"lat", "lon"}) for name in features),
        pictures=pictures,
        render=render,
    )


def cells(
    positions: Sequence[tuple[int, int]], features: Mapping[str, Sequence[float]], dates: Sequence[str] | str = DATE
) -> Cells:
    rows = np.array([row for row, _ in positions], dtype=np.int64)
    columns = np.array([column for _, column in positions], dtype=np.int64)
    texts = [dates] * len(positions) if isinstance(dates, str) else list(dates)
    values: dict[str, NDArray[np.float64]] = {
        name: np.array(numbers, dtype=np.float64) for name, numbers in features.items()
    }
    return Cells(rows, columns, np.array(texts, dtype=np.str_), values)


def plot(**changes: object) -> CubeContent:
    """Three rows of four cells, one of them without data, with excess green and brightness."""
    positions = [(row, column) for row in range(3) for column in range(4) if (row, column) != (1, 2)]
    exg = [10.0 + 3.0 * index for index in range(len(positions))]
    values = {"exg": exg, "brightness": [0.6] * len(positions)}
    return CubeContent(manifest(("exg", "brightness"), **changes), cells(positions, values))  # type: ignore[arg-type]  # tests name fields


def pictured(media: Sequence[Media] = (PIXEL, PIXEL)) -> CubeContent:
    """Two cells with a stored picture each, and a third without any but with its excess green."""
    positions = [(0, 0), (0, 1), (2, 3)]
    keys = cells(positions[: len(media)], {})
    pictures = Pictures(keys.rows, keys.columns, keys.dates, tuple(media))
    return CubeContent(manifest(pictures=PictureKind.STORED), cells(positions, {"exg": [96.0, 96.0, 40.0]}), pictures)


@dataclass
class MemoryStorage:
    """A storage for reading; what a context needs of the port."""

    objects: dict[str, bytes] = field(default_factory=dict)
    uri: str = "memory:///"

    def read(self, path: str) -> bytes:
        if path not in self.objects:
            raise ObjectNotFound(path)
        return self.objects[path]

    def write(self, path: str, data: bytes) -> None:
        self.objects[path] = data

    def append(self, path: str, data: bytes) -> None:
        self.objects[path] = self.objects.get(path, b"") + data

    def list(self, prefix: str) -> list[Entry]:
        start = f"{prefix}/" if prefix else ""
        return sorted(Entry(path, len(data)) for path, data in self.objects.items() if path.startswith(start))

    def exists(self, path: str) -> bool:
        return path in self.objects

    def delete(self, prefix: str) -> None:
        for path in [path for path in self.objects if path == prefix or path.startswith(f"{prefix}/")]:
            del self.objects[path]

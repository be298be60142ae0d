"""Import of located pictures: a folder, and a table that says where each of them was taken."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Media
from fleet.contexts.cells import Pictures
from fleet.contexts.importing.assemble import Located, Orientation, assemble
from fleet.contexts.importing.columns import choose_features, choose_truth
from fleet.contexts.importing.options import Imported, ImportOptions
from fleet.contexts.importing.points import grid_points, read_degrees
from fleet.contexts.importing.sheet import VERDICT, Sheet, read_sheet
from fleet.contexts.importing.table import COLUMN, ROW, check_grid, orient, positions_of
from fleet.contexts.manifest import BrokenContext
from fleet.errors import Problem

PICTURE = ("picture", "file", "filename", "image", "path", "photo")
MEDIA_TYPES = {
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".png": "image/png",
    ".ppm": "image/x-portable-pixmap",
    ".tif": "image/tiff",
    ".tiff": "image/tiff",
    ".webp": "image/webp",
}
Measure = Callable[[Media], Mapping[str, float]]
"""Features of a picture by name."""


def import_pictures(
    text: str, folder: Path, options: ImportOptions, measure: Measure | None = None, where: str = "the pictures"
) -> Imported:
    """Make a cube of pictures; all pictures of a cell are kept, their features are averaged.

    Args:
        text: A table with the column `picture` (a file in the folder), with `row` and `col` or `lat` and `lon`, and
            features, if any are known.
        folder: The pictures.
        options: What the table does not say. Without a truth the context can be flown, but not judged.
        measure: Measures features of each picture, such as `exg`; they are added to those of the table.
        where: Name of the source, for messages.

    Raises:
        BrokenContext: lists every bad line with its number, column and what to write.
    """
    sheet, notes = read_sheet(text, where, options.where)
    name = sheet.find(*PICTURE)
    if name is None:
        hint = f"give a column picture with a file's name; the table has {', '.join(sheet.header)}"
        raise BrokenContext(where, [Problem("header", "names no pictures", hint)], VERDICT)
    date = sheet.find("date")
    dates = sheet.dates(date, options.date)
    used = {name, *options.where, *(found for found in (date, sheet.find(*ROW), sheet.find(*COLUMN)) if found)}
    features, more = choose_features(sheet, options.features, used)
    rows, columns, orientation = _place(sheet, options, where)
    media = _read(sheet, name, folder)
    sheet.check()
    if measure is not None:
        features = {**features, **_measured(sheet, name, media, measure)}
        sheet.check()
    truth = choose_truth(options.truth, features, where) if options.truth or {"exg", "yield"} & set(features) else None
    pictures = Pictures(rows, columns, dates, tuple(media))
    located = Located(rows, columns, dates, features, orientation, truth, pictures)
    content = assemble(located, options, where)
    notes += [*more, f"{len(media)} pictures in {len(content.cells)} cells"]
    if truth is None:
        notes.append("no truth is known: missions over this context have no accuracy")
    return Imported(content, tuple(notes))


def _place(
    sheet: Sheet, options: ImportOptions, where: str
) -> tuple[NDArray[np.int64], NDArray[np.int64], Orientation]:
    row, column = sheet.find(*ROW), sheet.find(*COLUMN)
    if row is not None and column is not None:
        rows, columns, positions = sheet.integers(row), sheet.integers(column), positions_of(sheet)
        check_grid(sheet, rows, columns, options)
        sheet.check()
        return rows, columns, orient(rows, columns, positions, options, where)
    lat, lon = read_degrees(sheet)
    sheet.check()
    return grid_points(lat, lon, options)


def _read(sheet: Sheet, column: str, folder: Path) -> list[Media]:
    media = []
    for index, file in enumerate(sheet.texts(column)):
        kind = MEDIA_TYPES.get(Path(file).suffix.lower())
        if kind is None:
            sheet.blame(index, column, file, f"name a file that ends in {', '.join(MEDIA_TYPES)}")
            continue
        try:
            data = (folder / file).read_bytes()
        except (OSError, ValueError):  # ValueError: a null character in the name
            sheet.blame(index, column, file, f"there is no such file in {folder}; correct the name, or add the file")
            continue
        if not data:
            sheet.blame(index, column, file, "the file is empty; add the picture, or remove the line")
        media.append(Media(kind, data))
    return media


def _measured(sheet: Sheet, column: str, media: list[Media], measure: Measure) -> dict[str, NDArray[np.float64]]:
    measurements: list[Mapping[str, float]] = []
    for index, item in enumerate(media):
        try:
            measurements.append(measure(item))
        except Exception as error:  # noqa: BLE001 - the caller's code meets whatever bytes are in the files
            sheet.blame(index, column, sheet.texts(column)[index], f"it cannot be measured: {error}")
    names = sorted({name for measurement in measurements for name in measurement})
    return {name: np.array([found.get(name, np.nan) for found in measurements], dtype=np.float64) for name in names}

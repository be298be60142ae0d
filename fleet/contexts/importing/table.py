"""Import of tables that say in which row and column each line is: the layout of the corn cube."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.importing.assemble import Located, Orientation, assemble, metres
from fleet.contexts.importing.columns import choose_features, choose_truth
from fleet.contexts.importing.options import Imported, ImportOptions
from fleet.contexts.importing.sheet import VERDICT, Sheet, read_sheet
from fleet.contexts.manifest import BrokenContext
from fleet.errors import Problem

ROW = ("row", "rows", "r")
COLUMN = ("col", "column", "cols", "columns", "c")
LAT = ("lat", "latitude", "y")
LON = ("lon", "long", "lng", "longitude", "x")
MIN_POSITIONS = 3


def import_table(text: str, options: ImportOptions, where: str = "the table") -> Imported:
    """Make a cube of a table with `row` and `col`; several lines of a cell are averaged, missing cells stay missing.

    Args:
        text: The table with its header.
        options: What the table does not say.
        where: Name of the source, for messages.

    Raises:
        BrokenContext: lists every bad line with its number, column and what to write.
    """
    sheet, notes = read_sheet(text, where, options.where)
    row, column, date = sheet.find(*ROW), sheet.find(*COLUMN), sheet.find("date")
    if row is None or column is None:
        hint = f"give columns row and col, or lat and lon; the table has {', '.join(sheet.header)}"
        raise BrokenContext(where, [Problem("header", "says not in which cell the lines are", hint)], VERDICT)
    features, more = choose_features(sheet, options.features, {row, column, *options.where, *([date] if date else [])})
    rows, columns, dates = sheet.integers(row), sheet.integers(column), sheet.dates(date, options.date)
    positions = positions_of(sheet)
    check_grid(sheet, rows, columns, options)
    sheet.check()
    truth = choose_truth(options.truth, features, where)
    orientation = orient(rows, columns, positions, options, where)
    located = Located(rows, columns, dates, features, orientation, truth)
    content = assemble(located, options, where)
    notes += [*more, f"{len(sheet)} lines averaged to {len(content.cells)} cells"]
    return Imported(content, tuple(notes))


def positions_of(sheet: Sheet) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Latitude and longitude of every line, when the table has them."""
    lat, lon = sheet.find(*LAT), sheet.find(*LON)
    return None if lat is None or lon is None else (sheet.floats(lat), sheet.floats(lon))


def check_grid(sheet: Sheet, rows: NDArray[np.int64], columns: NDArray[np.int64], options: ImportOptions) -> None:
    """Blame lines that are outside of a grid of given size."""
    for names, numbers, size in ((ROW, rows, options.rows), (COLUMN, columns, options.columns)):
        name = sheet.find(*names) or names[0]
        for index in np.flatnonzero(numbers >= (size or 4096)).tolist():
            sheet.blame(index, name, str(numbers[index]), f"the grid has 0 to {(size or 4096) - 1}")


def orient(
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    positions: tuple[NDArray[np.float64], NDArray[np.float64]] | None,
    options: ImportOptions,
    where: str,
) -> Orientation:
    """Size and direction of cells, as given, else measured from the positions by least squares, to 0.1 m.

    Raises:
        BrokenContext: a size is neither given nor can be measured.
    """
    measured = _measured(rows, columns, positions)
    height, width = options.cell_height_m, options.cell_width_m
    if measured is None:
        if height is None or width is None:
            hint = "give the height and width of a cell in m, or columns lat and lon"
            raise BrokenContext(where, [Problem("cell size", "is not known", hint)], VERDICT)
        measured = Orientation(height, width)
    return Orientation(
        measured.cell_height_m if height is None else height,
        measured.cell_width_m if width is None else width,
        measured.rows_go_south if options.rows_go_south is None else options.rows_go_south,
        measured.columns_go_east if options.columns_go_east is None else options.columns_go_east,
    )


def _measured(
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    positions: tuple[NDArray[np.float64], NDArray[np.float64]] | None,
) -> Orientation | None:
    if positions is None:
        return None
    known = np.isfinite(positions[0]) & np.isfinite(positions[1])
    if known.sum() < MIN_POSITIONS:
        return None
    north, east = metres(positions[0][known], positions[1][known])
    design = np.stack([rows[known], columns[known], np.ones(known.sum())], axis=1)
    if np.linalg.matrix_rank(design) < design.shape[1]:
        return None
    south_m = -float(np.linalg.lstsq(design, north)[0][0])
    east_m = float(np.linalg.lstsq(design, east)[0][1])
    height, width = round(abs(south_m), 1), round(abs(east_m), 1)
    return Orientation(height, width, south_m > 0, east_m > 0) if height > 0 and width > 0 else None

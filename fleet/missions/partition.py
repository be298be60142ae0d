"""A part of the field for each agent: equally many cells, compact, and in one piece where the field is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from fleet.contexts.grid import Grid
from fleet.errors import MissionError

Cells = NDArray[np.int64]


def parts(grid: Grid, agents: int) -> tuple[Cells, ...]:
    """Cut a field's cells with data into parts whose sizes differ by one cell at most.

    The cells are halved, and the halves again, across the longer side; across the shorter one where only that leaves
    the halves in fewer pieces.

    Returns:
        The cells of each part, ascending.
    Raises:
        MissionError: there are fewer cells than agents.
    """
    cells = np.flatnonzero(grid.valid)
    if len(cells) < agents:
        raise MissionError(f"{agents} agents but only {len(cells)} cells with data")
    bounds: Cells = np.linspace(0, len(cells), agents + 1).round().astype(np.int64)
    sizes = bounds[1:] - bounds[:-1]
    return tuple(np.sort(part) for part in _cut(grid, cells, sizes))


def _cut(grid: Grid, cells: Cells, sizes: Cells) -> list[Cells]:
    if len(sizes) == 1:
        return [cells]
    middle = len(sizes) // 2
    first = int(sizes[:middle].sum())
    rows, columns = np.divmod(cells, grid.columns)
    by_row, by_column = np.lexsort((columns, rows)), np.lexsort((rows, columns))
    orders = [by_row, by_column] if np.ptp(rows) >= np.ptp(columns) else [by_column, by_row]
    halves = [(cells[order[:first]], cells[order[first:]]) for order in orders]
    best = min(halves, key=lambda pair: pieces(grid, pair[0]) + pieces(grid, pair[1]))
    return _cut(grid, best[0], sizes[:middle]) + _cut(grid, best[1], sizes[middle:])


def pieces(grid: Grid, cells: Cells) -> int:
    """How many pieces some cells fall into; cells that touch at a corner are in one."""
    inside = np.zeros(grid.cells, dtype=np.bool_)
    inside[cells] = True
    return int(label(inside.reshape(grid.rows, grid.columns), np.ones((3, 3)))[1])


def middle(grid: Grid, cells: Cells) -> int:
    """The cell that is nearest to the centre of some, the first of equals."""
    rows, columns = np.divmod(cells, grid.columns)
    down, across = (rows - rows.mean()) * grid.cell_height_m, (columns - columns.mean()) * grid.cell_width_m
    return int(cells[np.argmin(np.square(down) + np.square(across))])

"""The states of a context that lie on a grid, and which of them have data."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fleet.errors import ContextError
from fleet.spec.swarm import Action

_STEPS: dict[Action, tuple[int, int]] = {
    Action.NORTH: (1, 0),
    Action.SOUTH: (-1, 0),
    Action.EAST: (0, 1),
    Action.WEST: (0, -1),
    Action.NORTH_EAST: (1, 1),
    Action.NORTH_WEST: (1, -1),
    Action.SOUTH_EAST: (-1, 1),
    Action.SOUTH_WEST: (-1, -1),
}
"""Steps to the north and to the east."""


@dataclass(frozen=True, eq=False)
class Grid:
    """A rectangle of cells; a cell is a state, numbered row by row from 0.

    Args:
        valid: Which cells have data; bool [rows, columns].
        cell_height_m, cell_width_m: Size of a cell along a column and along a row, in m.
        rows_go_south: Whether the row number grows to the south.
        columns_go_east: Whether the column number grows to the east.
    """

    valid: NDArray[np.bool_]
    cell_height_m: float = 1.0
    cell_width_m: float = 1.0
    rows_go_south: bool = True
    columns_go_east: bool = True
    rows: int = field(init=False)
    columns: int = field(init=False)

    def __post_init__(self) -> None:
        if self.valid.ndim != 2 or not self.valid.size:
            raise ContextError("a grid needs at least one row and one column")
        object.__setattr__(self, "rows", int(self.valid.shape[0]))
        object.__setattr__(self, "columns", int(self.valid.shape[1]))

    @property
    def cells(self) -> int:
        """Number of cells, with and without data."""
        return self.rows * self.columns

    def cell(self, row: int, column: int) -> int:
        """The number of the cell at a row and column."""
        return row * self.columns + column

    def position(self, cell: int) -> tuple[int, int]:
        """Row and column of a cell."""
        return divmod(cell, self.columns)

    def step(self, action: Action) -> tuple[int, int]:
        """By how many rows and columns an action moves on this grid."""
        north, east = _STEPS[action]
        return (-north if self.rows_go_south else north), (east if self.columns_go_east else -east)

    def neighbour(self, cell: int, action: Action) -> int | None:
        """The cell that an action leads to; None beyond the edge."""
        row, column = self.position(cell)
        rows, columns = self.step(action)
        if 0 <= row + rows < self.rows and 0 <= column + columns < self.columns:
            return self.cell(row + rows, column + columns)
        return None

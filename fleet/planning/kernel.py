"""The compiled search for a path; see `fleet.planning.paths`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fleet.compiled import part, program

_int: Any = np.int64  # Any: numba's integers are not numpy's to a type checker


class Beam(NamedTuple):
    """Paths of each length that are followed further, best first, [horizon + 1, width].

    Args:
        cell: Where each ends.
        parent: Index of the path, one shorter, that it goes on from.
        move: Its last move; -1 for none.
        value: What it is worth.
    """

    cell: NDArray[np.int64]
    parent: NDArray[np.int64]
    move: NDArray[np.int64]
    value: NDArray[np.float64]


@part
def _is_on(beam: Any, depth: Any, index: Any, cell: Any) -> Any:
    """Whether a path passes a cell."""
    found = False
    while depth > 0 and not found:
        found = beam.cell[depth, index] == cell
        index = beam.parent[depth, index]
        depth -= 1
    return found


@part
def _insert(beam: Any, depth: Any, count: Any, path: Any) -> Any:
    """Put a path (cell, parent, move, value) among those of its length; how many there are now.

    Of two that end in one cell by the same move and are worth the same, the first stays: they are the same way in
    another order. By another move they would not be: each may go on where the other came from, and not back.
    """
    cell, parent, move, value = path
    at = count
    while at > 0 and beam.value[depth, at - 1] < value:
        at -= 1
    same = at
    while same > 0 and beam.value[depth, same - 1] == value:
        if beam.cell[depth, same - 1] == cell and beam.move[depth, same - 1] == move:
            break
        same -= 1
    width = beam.cell.shape[1]
    if at < width and not (same > 0 and beam.value[depth, same - 1] == value):
        count = min(count + 1, width)
        for place in range(count - 1, at, -1):
            beam.cell[depth, place] = beam.cell[depth, place - 1]
            beam.parent[depth, place] = beam.parent[depth, place - 1]
            beam.move[depth, place] = beam.move[depth, place - 1]
            beam.value[depth, place] = beam.value[depth, place - 1]
        beam.cell[depth, at] = cell
        beam.parent[depth, at] = parent
        beam.move[depth, at] = move
        beam.value[depth, at] = value
    return count


@program
def search(beam: Any, worth: Any, steps: Any, costs: Any, start: Any) -> Any:
    """Fill a beam with paths from a cell.

    Args:
        beam: Room for the paths.
        worth: What the first visit of each cell adds, its cost subtracted, float64 [rows, columns]; 0 in cells that
            have nothing to give.
        steps: Rows and columns of each move, int64 [moves, 2]; move 2n + 1 is the reverse of move 2n.
        costs: What each move costs, float64 [moves].
        start: First cell, and the move that led into it or -1.

    Returns:
        Length of the path that is worth most: the first of its length, and 0 when no path is worth its cost.
    """
    rows, columns = worth.shape
    beam.cell[0, 0], beam.parent[0, 0], beam.move[0, 0], beam.value[0, 0] = start[0], 0, start[1], 0.0
    count, longest, most = _int(1), _int(0), 0.0
    for depth in range(beam.cell.shape[0] - 1):
        found = _int(0)
        for index in range(count):
            row, column = beam.cell[depth, index] // columns, beam.cell[depth, index] % columns
            before = beam.move[depth, index]
            for move in range(len(steps)):
                down, right = row + steps[move, 0], column + steps[move, 1]
                if (before >= 0 and before ^ 1 == move) or not (0 <= down < rows and 0 <= right < columns):
                    continue
                cell = down * columns + right
                value = beam.value[depth, index] - costs[move]
                if worth[down, right] != 0.0 and not _is_on(beam, depth, index, cell):
                    value += worth[down, right]
                found = _insert(beam, depth + 1, found, (cell, index, move, value))
        count = found
        if count == 0:
            break
        if beam.value[depth + 1, 0] > most:
            longest, most = depth + 1, beam.value[depth + 1, 0]
    return longest

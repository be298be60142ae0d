"""Paths over the grid, cell by cell, with straight moves only, as the default FleetSpec's agents have them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bench.scouting.flight import Flights, flown
from fleet.contexts.grid import Grid

Cells = NDArray[np.int64]
NONE: Cells = np.zeros(0, dtype=np.int64)


def between(grid: Grid, start: int, end: int, rows_first: bool = True) -> Cells:
    """The cells from one to another, both included: all rows and then all columns, or the other way round."""
    (row, column), (last_row, last_column) = grid.position(start), grid.position(end)
    down = _range(row, last_row)
    across = _range(column, last_column)
    if rows_first:
        return np.concatenate((down * grid.columns + column, last_row * grid.columns + across[1:]))
    return np.concatenate((row * grid.columns + across, down[1:] * grid.columns + last_column))


def through(grid: Grid, stops: Sequence[int] | Cells) -> Cells:
    """The path through some cells in their order; along the longer way first."""
    if not len(stops):
        return NONE
    legs = [np.asarray(stops[:1], dtype=np.int64)]
    for start, end in pairwise(np.asarray(stops).tolist()):
        rows, columns = np.subtract(grid.position(end), grid.position(start))
        legs.append(between(grid, start, end, rows_first=abs(rows) >= abs(columns))[1:])
    return np.concatenate(legs)


def serpentine(grid: Grid, lines: Iterable[int], along_rows: bool) -> Cells:
    """The path along whole lines, back and forth, each from its first to its last cell with data.

    Args:
        lines: Rows or columns in the order of flight; lines without data are left out.
    """
    path: list[Cells] = []
    forth = True
    for line in lines:
        found = np.flatnonzero(grid.valid[line] if along_rows else grid.valid[:, line])
        if not len(found):
            continue
        ends = (found[0], found[-1]) if forth else (found[-1], found[0])
        places = _range(int(ends[0]), int(ends[1]))
        cells = line * grid.columns + places if along_rows else places * grid.columns + line
        if path:
            path.append(between(grid, int(path[-1][-1]), int(cells[0]), rows_first=not along_rows)[1:-1])
        path.append(cells)
        forth = not forth
    return np.concatenate(path) if path else NONE


def shared_out(grid: Grid, path: Cells, agents: int) -> Flights:
    """One path cut into pieces of equal energy, one for each agent; everything on the way is captured once.

    An agent whose piece has no cell with data stays on the ground.
    """
    whole = flown(grid, path)
    if not len(path):
        return (whole,) * agents
    cuts = np.searchsorted(whole.energy_j, np.linspace(0.0, whole.energy_j[-1], agents + 1)[1:-1])
    first = np.zeros(len(path), dtype=np.bool_)
    first[whole.captured] = True
    flights = []
    for piece, new in zip(np.split(path, cuts), np.split(first, cuts), strict=True):
        some = np.flatnonzero(new)
        kept = slice(some[0], some[-1] + 1) if len(some) else slice(0, 0)
        flights.append(flown(grid, piece[kept], new[kept]))
    return tuple(flights)


def _range(start: int, end: int) -> Cells:
    step = 1 if end >= start else -1
    return np.arange(start, end + step, step, dtype=np.int64)

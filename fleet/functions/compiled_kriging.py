"""Prepares arrays for the compiled form of kriging; cells far from all captured ones are left to the tree."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.grid import Grid
from fleet.functions import kriging_kernel, local_kriging
from fleet.functions.local_kriging import Cells, Flags, Places, Values

_STEPS = 4096
"""How many cells around a target are looked at at most, about; with 5 % of the cells captured, 160 are on average."""


class Scratch(NamedTuple):
    """For intermediate results of one system.

    Args:
        factor: Cholesky's factor, the inverse of its diagonal, and three solutions, float64 [count, count + 4].
        position: Row and column of each neighbour, int64 [count, 2].
    """

    factor: NDArray[np.float64]
    position: NDArray[np.int64]


def scratch_for(count: int) -> Scratch:
    """Room for systems of so many neighbours."""
    return Scratch(np.empty((count, count + 4)), np.empty((count, 2), dtype=np.int64))


class Steps(NamedTuple):
    """Ways from a cell to all cells around it, by distance and then by number.

    Args:
        margin: Rows and columns that cells without data need around the grid, so that no step leads out.
        way: By how much the number of a cell grows, in a grid with the margin, int64 [steps].
        change: The same in the grid, int32 [steps].
        length: In widths of a cell, float64 [steps].
    """

    margin: tuple[int, int]
    way: NDArray[np.int64]
    change: NDArray[np.int32]
    length: NDArray[np.float64]


def nearest(known: Flags, targets: Cells, grid: Grid, count: int) -> Cells:
    """As `local_kriging.nearest`."""
    steps = steps_for(grid)
    near = np.empty((len(targets), count), dtype=np.int32)
    if kriging_kernel.search(with_margin(known, steps), targets, grid.columns, steps, near):
        far = np.flatnonzero(near[:, 0] < 0)
        near[far] = local_kriging.nearest(known, targets[far], grid, count)
    return near


def solve(near: Cells, targets: Cells, values: Values, places: Places) -> tuple[Values, Values]:
    """As `local_kriging.solve`."""
    found = np.empty((2, len(targets)))
    kriging_kernel.solve(near, targets, (values, places), scratch_for(near.shape[1]), found)
    return found[0], found[1]


def steps_for(grid: Grid) -> Steps:
    """Steps to the 4,096 or so nearest cells; those of a grid are made once, so do not change them."""
    return _steps(grid.rows, grid.columns, grid.cell_height_m / grid.cell_width_m)


def with_margin(known: Flags, steps: Steps) -> NDArray[np.uint8]:
    """Captured cells, bool [rows, columns], with the margin that the steps need."""
    down, across = steps.margin
    return np.pad(known.astype(np.uint8), ((down, down), (across, across)))


@functools.lru_cache(maxsize=16)
def _steps(rows: int, columns: int, ratio: float) -> Steps:
    """Steps to all cells within a distance."""
    reach = _STEPS / np.pi * ratio  # squared, in widths of a cell
    margin = (min(int(reach**0.5 / ratio), rows - 1), min(int(reach**0.5), columns - 1))
    down, right = np.meshgrid(*(np.arange(-size, size + 1) for size in margin), indexing="ij")
    apart = local_kriging.squared_distance(down, right, ratio * ratio)
    near = (apart <= reach) & (apart > 0)
    down, right, apart = down[near], right[near], apart[near]
    order = np.lexsort((right, down, apart))
    down, right = down[order], right[order]
    way = down * (columns + 2 * margin[1]) + right
    return Steps(margin, way, (down * columns + right).astype(np.int32), np.sqrt(apart[order]))

"""Ordinary kriging from a few neighbours, in numpy: the form that runs everywhere.

`fleet.functions.kriging_kernel` is the compiled form. Both do the same operations on the same numbers in the same
order, so their results are the same bits, and it does not matter which of them made a map.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fleet.contexts.grid import Grid

Values = NDArray[np.float64]
Flags = NDArray[np.bool_]
Cells = NDArray[np.int32]

NEIGHBOURS = 8
"""Captured cells that predict a cell; on the fields of bench/extrapolation.py more are slower and no better."""
NEAR_ONE = 1.0 + 1e-9
"""Covariance of a cell with itself; a little more than 1, so that a smooth field's systems can be solved."""
LEAST_PIVOT = 1e-12
"""Covariances that are singular in floating point are taken for ones that just are not."""
_AT_ONCE = 4096
"""Systems that are solved together: what they need stays in the processor's cache."""


class Places(NamedTuple):
    """Where cells are, and how alike they are.

    Args:
        row, column: Of each cell, int32 [cells].
        aspect: Square of a cell's height over its width: distances are compared in widths of a cell.
        covariance: Of two cells by rows and columns between them, as a share of the variance, [rows, columns].
    """

    row: Cells
    column: Cells
    aspect: float
    covariance: Values


def squared_distance(rows: NDArray[np.int64], columns: NDArray[np.int64], aspect: float) -> Values:
    """Squared distance in widths of a cell; exact for square cells, so that equally near is equal."""
    return np.asarray(rows * rows * aspect + columns * columns)


def nearest(known: Flags, targets: Cells, grid: Grid, count: int) -> Cells:
    """The captured cells nearest to each target, nearest first; of equally near ones that with the lower number.

    Args:
        known: Captured cells, bool [rows, columns], at least `count`.
        targets: Cell numbers, [targets].

    Returns:
        Cell numbers, int32 [targets, count].
    """
    ratio = grid.cell_height_m / grid.cell_width_m
    sources = np.flatnonzero(known)
    rows, columns = np.divmod(sources, grid.columns)
    tree = cKDTree(np.stack((rows * ratio, columns), axis=1))
    to_rows, to_columns = np.divmod(targets.astype(np.int64), grid.columns)
    places = np.stack((to_rows * ratio, to_columns), axis=1)
    result = np.empty((len(targets), count), dtype=np.int32)
    left, asked = np.arange(len(targets)), 2 * count
    while len(left):
        asked = min(asked, len(sources))
        found = tree.query(places[left], k=asked)[1].reshape(len(left), asked)
        found.sort(axis=1)
        apart = squared_distance(
            rows[found] - to_rows[left, None], columns[found] - to_columns[left, None], ratio * ratio
        )
        order = np.argsort(apart, axis=1, kind="stable")
        apart = np.take_along_axis(apart, order, axis=1)
        sure = (apart[:, -1] > apart[:, count - 1] * (1 + 1e-9)) | (asked == len(sources))
        result[left[sure]] = sources[np.take_along_axis(found, order[:, :count], axis=1)[sure]]
        left, asked = left[~sure], 2 * asked
    return result


def solve(near: Cells, targets: Cells, values: Values, places: Places) -> tuple[Values, Values]:
    """Expected value of each target, and its variance as a share of the field's.

    By Cholesky's factor L of the neighbours' covariances: with y, z and v the solutions of L x = covariances with the
    target, ones, and values above that of the nearest neighbour, the multiplier of Lagrange is m = (z y - 1) / z z, the
    expected value above that (y - m z) v, and the variance 1 - y y + m (z y - 1).

    Args:
        near: Neighbours of each target, [targets, count].
        values: Value of every cell, [cells]; those of captured cells are used.
    """
    expected, share = np.empty(len(targets)), np.empty(len(targets))
    for start in range(0, len(targets), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        expected[part], share[part] = _solve(near[part].T, targets[part], values, places)
    return expected, share


def _solve(near: Cells, targets: Cells, values: Values, places: Places) -> tuple[Values, Values]:
    """As `solve`; the systems are the last axis of all arrays."""
    count = len(near)
    row, column = places.row[near], places.column[near]
    factor = places.covariance[np.abs(row[:, None] - row[None]), np.abs(column[:, None] - column[None])]
    factor[np.arange(count), np.arange(count)] = NEAR_ONE
    sides = np.empty((3, count, len(targets)))
    sides[0] = places.covariance[np.abs(row - places.row[targets]), np.abs(column - places.column[targets])]
    sides[1] = 1.0
    base = values[near[0]]
    sides[2] = values[near] - base
    for k in range(count):
        scale = 1.0 / np.sqrt(np.maximum(factor[k, k], LEAST_PIVOT))
        factor[k + 1 :, k] *= scale
        sides[:, k] *= scale
        for i in range(k + 1, count):
            factor[i, k + 1 : i + 1] -= factor[i, k] * factor[k + 1 : i + 1, k]
            sides[:, i] -= factor[i, k] * sides[:, k]
    y, z, v = sides
    yy, zy, zz, yv, zv = (_dot(*pair) for pair in ((y, y), (z, y), (z, z), (y, v), (z, v)))
    multiplier = (zy - 1.0) / zz
    return base + (yv - multiplier * zv), np.maximum(1.0 - yy + multiplier * (zy - 1.0), 0.0)


def _dot(first: Values, second: Values) -> Values:
    """Sum of products over the first axis, one after the other."""
    total = first[0] * second[0]
    for k in range(1, len(first)):
        total = total + first[k] * second[k]
    return np.asarray(total)

"""The compiled form of `fleet.functions.local_kriging`: the same results, bit by bit.

What makes it fast, by measurement: neighbours are looked for in the order of their distance, in a list of steps that is
made once for a grid; each system is factored in place, row by row, by one core's registers and nearest cache; nothing
is allocated.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

from fleet.compiled import part, program
from fleet.functions.local_kriging import LEAST_PIVOT, NEAR_ONE


@part
def expect(near: Any, count: Any, target: Any, values: Any, places: Any, factor: Any) -> Any:
    """Expected value of a target, and its variance as a share of the field's; see `local_kriging.solve`.

    Args:
        near: Its neighbours, int32 [count or more].
        factor: For intermediate results, float64 [count, count + 4].
    """
    row, column, _, covariance = places
    yy, zy, zz, yv, zv = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        place = near[i]
        y = covariance[abs(row[place] - row[target]), abs(column[place] - column[target])]
        z, v, pivot = 1.0, values[place], NEAR_ONE
        for j in range(i):
            x = covariance[abs(row[place] - row[near[j]]), abs(column[place] - column[near[j]])]
            for k in range(j):
                x -= factor[i, k] * factor[j, k]
            x *= factor[j, count]
            factor[i, j] = x
            pivot -= x * x
            y -= x * factor[j, count + 1]
            z -= x * factor[j, count + 2]
            v -= x * factor[j, count + 3]
        scale = 1.0 / sqrt(max(pivot, LEAST_PIVOT))
        y *= scale
        z *= scale
        v *= scale
        factor[i, count], factor[i, count + 1], factor[i, count + 2], factor[i, count + 3] = scale, y, z, v
        yy += y * y
        zy += z * y
        zz += z * z
        yv += y * v
        zv += z * v
    multiplier = (zy - 1.0) / zz
    return yv - multiplier * zv, max(1.0 - yy + multiplier * (zy - 1.0), 0.0)


@part
def _first(apart: Any, bound: Any) -> Any:
    """Number of steps that are shorter than a bound."""
    low, high = 0, len(apart)
    while low < high:
        middle = (low + high) >> 1
        if apart[middle] < bound:
            low = middle + 1
        else:
            high = middle
    return low


@program
def search(known: Any, corners: Any, steps: Any, apart: Any, near: Any) -> Any:
    """Neighbours of each target, nearest first, as far as the list of steps goes.

    A target beside the last one has no neighbour that is nearer than the last one's nearest by more than one cell.

    Args:
        known: Captured cells with a margin as wide as the longest step, uint8 [cells with margin].
        corners: Numbers of the targets in that, ascending, int64 [targets].
        steps: To all cells around, by distance and then by number, int64 [steps].
        apart: How long each step is, in widths of a cell, float64 [steps].
        near: Result, in numbers of that, int32 [targets, count]; -1 in the first place where the steps do not suffice.

    Returns:
        Number of targets for which they do not.
    """
    lacking, count = 0, near.shape[1]
    nearest = 0.0
    for target in range(len(corners)):
        corner = corners[target]
        beside = target > 0 and corner == corners[target - 1] + 1
        start = _first(apart, nearest - 1.0 - 1e-6) if beside and nearest > 2.0 else 0
        found = 0
        nearest = apart[-1]
        for step in range(start, len(steps)):
            place = corner + steps[step]
            if known[place]:
                near[target, found] = place
                nearest = apart[step] if found == 0 else nearest
                found += 1
                if found == count:
                    break
        if found < count:
            near[target, 0] = -1
            lacking += 1
    return lacking


@program
def solve(near: Any, targets: Any, values: Any, places: Any, factor: Any, found: Any) -> None:
    """As `local_kriging.solve`, into `found`, float64 [2, targets]; `factor` as for `expect`."""
    for index in range(len(targets)):
        found[0, index], found[1, index] = expect(near[index], near.shape[1], targets[index], values, places, factor)

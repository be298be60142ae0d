"""The compiled form of `fleet.functions.local_kriging`: the same results, bit by bit.

What makes it fast, by measurement: neighbours are looked for in the order of their distance, in a list of steps that is
made once for a grid; each system is factored in place, row by row, by one core's registers and nearest cache; nothing
is allocated.
"""

from __future__ import annotations

from math import erf, exp, pi, sqrt
from typing import Any

import numpy as np

from fleet.compiled import part, program
from fleet.functions.local_kriging import LEAST_PIVOT, NEAR_ONE, NEIGHBOURS

_int: Any = np.int64  # Any: numba's integers are not numpy's to a type checker
_word: Any = np.uint64
_ROW, _COLUMN = _word(0), _word(1)
TILE = 16
"""Cells along the side of a tile: a captured cell is held against the widest reach of each tile first."""
_END, _KNOTS_PER_UNIT = 8.5, 32
"""The normal distribution is tabulated from -8.5 to 8.5 deviations, beyond which it is 0 or 1 in floating point."""
_KNOTS = np.arange(int(2 * _END * _KNOTS_PER_UNIT) + 1) / _KNOTS_PER_UNIT - _END
_NORMAL = np.array([0.5 * (1.0 + erf(knot / sqrt(2.0))) for knot in _KNOTS])
_DENSITY = np.array([exp(-knot * knot / 2.0) / sqrt(2.0 * pi) for knot in _KNOTS])


@part
def _expect(near: Any, count: Any, target: Any, known: Any, scratch: Any) -> Any:
    """As `expect`; indices are unsigned, because numba looks whether others are negative."""
    values, (row, column, _, covariance) = known
    factor, position = scratch
    scales, ys, zs, vs = _word(count), _word(count + 1), _word(count + 2), _word(count + 3)
    to_row, to_column, base = _int(row[target]), _int(column[target]), values[near[0]]
    yy, zy, zz, yv, zv = 0.0, 0.0, 0.0, 0.0, 0.0
    for number in range(count):
        i = _word(number)
        place = _word(near[i])
        down, right = _int(row[place]), _int(column[place])
        position[i, _ROW], position[i, _COLUMN] = down, right
        y = covariance[_word(abs(down - to_row)), _word(abs(right - to_column))]
        z, v, pivot = 1.0, values[place] - base, NEAR_ONE
        for earlier in range(number):
            j = _word(earlier)
            x = covariance[_word(abs(down - position[j, _ROW])), _word(abs(right - position[j, _COLUMN]))]
            for k in range(earlier):
                x -= factor[i, _word(k)] * factor[j, _word(k)]
            x *= factor[j, scales]
            factor[i, j] = x
            pivot -= x * x
            y -= x * factor[j, ys]
            z -= x * factor[j, zs]
            v -= x * factor[j, vs]
        scale = 1.0 / sqrt(max(pivot, LEAST_PIVOT))
        y, z, v = y * scale, z * scale, v * scale
        factor[i, scales], factor[i, ys], factor[i, zs], factor[i, vs] = scale, y, z, v
        yy, zy, zz, yv, zv = yy + y * y, zy + z * y, zz + z * z, yv + y * v, zv + z * v
    multiplier = (zy - 1.0) / zz
    return base + (yv - multiplier * zv), max(1.0 - yy + multiplier * (zy - 1.0), 0.0)


@part
def expect(near: Any, count: Any, target: Any, known: Any, scratch: Any) -> Any:
    """Expected value of a target, and its variance as a share of the field's; see `local_kriging.solve`.

    Args:
        near: Its neighbours, int32 [count or more].
        known: Values of cells, and their `Places`.
        scratch: `compiled_kriging.Scratch`.
    """
    if count == NEIGHBOURS:  # the processor's code is better with a number that it knows
        return _expect(near, NEIGHBOURS, target, known, scratch)
    return _expect(near, count, target, known, scratch)


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


@part
def look(known: Any, corner: Any, target: Any, steps: Any, start: Any, near: Any) -> Any:
    """Write the nearest captured cells of one cell, nearest first, as far as the list of steps goes.

    With `expect`, this predicts one cell of a field of which only the captured cells are kept.

    Args:
        known: Captured cells, with the margin of the steps, uint8 [cells and margin].
        corner: Number of the target in that.
        start: The first step to take.
        near: Result, int32 [count].

    Returns:
        How many were found, and the number of the step to the nearest.
    """
    found, first = 0, len(steps.way)
    for step in range(start, len(steps.way)):
        if known[_word(corner + steps.way[_word(step)])]:
            near[found] = target + steps.change[step]
            first = step if found == 0 else first
            found += 1
            if found == len(near):
                break
    return found, first


@program
def search(known: Any, targets: Any, columns: Any, steps: Any, near: Any) -> Any:
    """Neighbours of each target, nearest first, as far as the list of steps goes.

    A target beside the last one has no neighbour that is nearer than the last one's nearest by more than one cell.

    Args:
        known: As for `look`, [rows and margin, columns and margin].
        targets: Cell numbers, ascending, int32 [targets].
        columns: Of the grid.
        steps: `compiled_kriging.Steps`.
        near: Result, int32 [targets, count]; -1 in the first place where the steps do not suffice.

    Returns:
        Number of targets for which they do not.
    """
    flat, width = known.reshape(-1), known.shape[1]
    lacking, nearest = 0, 0.0
    for number in range(len(targets)):
        target = targets[number]
        row, column = divmod(_int(target), columns)
        corner = (row + steps.margin[0]) * width + column + steps.margin[1]
        beside = number > 0 and target == targets[number - 1] + 1 and column > 0
        start = _first(steps.length, nearest - 1.0 - 1e-6) if beside and nearest > 2.0 else 0
        found, first = look(flat, corner, target, steps, start, near[number])
        if len(steps.way):
            nearest = steps.length[min(first, len(steps.way) - 1)]
        if found < near.shape[1]:
            near[number, 0] = -1
            lacking += 1
    return lacking


@program
def solve(near: Any, targets: Any, known: Any, scratch: Any, found: Any) -> None:
    """As `local_kriging.solve`, into `found`, float64 [2, targets]."""
    for index in range(len(targets)):
        found[0, index], found[1, index] = expect(near[index], near.shape[1], targets[index], known, scratch)


@part
def _apart(places: Any, first: Any, second: Any) -> Any:
    """Squared distance of two cells, as `local_kriging.squared_distance`."""
    rows = _int(places.row[first]) - places.row[second]
    columns = _int(places.column[first]) - places.column[second]
    return rows * rows * places.aspect + columns * columns


@part
def _insert(belief: Any, cell: Any, captured: Any, apart: Any) -> None:
    """Put a captured cell among a cell's neighbours, which are in order of distance, and then of number."""
    near, places = belief.near, belief.places
    count = near.shape[1]
    at = min(belief.captured[0], count - 1)
    while at > 0:
        other = near[cell, at - 1]
        distance = _apart(places, cell, other)
        if distance < apart or (distance == apart and other < captured):
            break
        near[cell, at] = other
        at -= 1
    near[cell, at] = captured
    if belief.captured[0] >= count - 1:
        belief.reach[cell] = _apart(places, cell, near[cell, count - 1])


@part
def _reach_tile(belief: Any, tile: Any, captured: Any, changed: Any) -> Any:
    """Tell the cells of a tile of a captured cell; the number of cells that have changed so far."""
    reach, near, marked = belief.reach, belief.near, belief.marked
    rows, columns = belief.places.covariance.shape
    top, left = tile[0] * TILE, tile[1] * TILE
    widest, last = -1.0, near.shape[1] - 1
    for row in range(top, min(top + TILE, rows)):
        for cell in range(row * columns + left, row * columns + min(left + TILE, columns)):
            if reach[cell] < 0.0:
                continue
            apart = _apart(belief.places, cell, captured)
            if apart < reach[cell] or (apart == reach[cell] and captured < near[cell, last]):
                _insert(belief, cell, captured, apart)
                if not marked[cell]:
                    marked[cell] = True
                    belief.changed[changed] = cell
                    changed += 1
            widest = max(widest, reach[cell])
    belief.widest[tile] = widest
    return changed


@part
def _beyond(place: Any, tile: Any) -> Any:
    """How many rows or columns a place is outside of a tile."""
    return max(_int(tile * TILE - place), _int(place - (tile * TILE + TILE - 1)), _int(0))


@part
def take_in(belief: Any, cell: Any, value: Any, changed: Any) -> Any:
    """Capture a cell: it becomes a neighbour of all cells to which it is near enough; the number of changed cells.

    A cell that is captured or has no data stays as it is.
    """
    if belief.reach[cell] < 0.0 or not np.isfinite(value):
        return changed
    places, widest = belief.places, belief.widest
    belief.total[0] += value - belief.mean[cell]
    belief.values[cell] = value - belief.trend[cell]
    belief.mean[cell] = value
    belief.deviation[cell] = 0.0
    belief.reach[cell] = -1.0
    belief.free[cell] = False
    belief.left[places.row[cell] // TILE, places.column[cell] // TILE] -= 1
    for row in range(widest.shape[0]):
        down = _beyond(places.row[cell], row)
        for column in range(widest.shape[1]):
            right = _beyond(places.column[cell], column)
            if down * down * places.aspect + right * right <= widest[row, column]:
                changed = _reach_tile(belief, (row, column), cell, changed)
    belief.captured[0] += 1
    return changed


@part
def settle(belief: Any, changed: Any) -> None:
    """Predict the cells that have changed anew."""
    count = min(belief.captured[0], belief.near.shape[1])
    known = (belief.values, belief.places)
    for index in range(changed):
        cell = belief.changed[index]
        belief.marked[cell] = False
        if belief.reach[cell] >= 0.0:
            expected, share = expect(belief.near[cell], count, cell, known, belief.scratch)
            expected += belief.trend[cell]
            belief.total[0] += expected - belief.mean[cell]
            belief.mean[cell] = expected
            belief.deviation[cell] = sqrt(share * belief.variance + belief.spread[cell])


@program
def observe(belief: Any, cells: Any, values: Any) -> Any:
    """Capture cells, and list in `belief.changed` those that `settle` is to predict anew; their number."""
    changed = 0
    for index in range(len(cells)):
        changed = take_in(belief, cells[index], values[index], changed)
    return changed


@program
def predict_changed(belief: Any, changed: Any) -> None:
    """As `settle`."""
    settle(belief, changed)


@part
def below(bound: Any, mean: Any, deviation: Any) -> Any:
    """Probability that a value is at most a bound, to 1e-12: the normal distribution, by Taylor's series at a knot."""
    if deviation == 0.0:
        return 1.0 if mean <= bound else 0.0
    x = min(max((bound - mean) / deviation, -_END), _END)
    knot = _word((x + _END) * _KNOTS_PER_UNIT + 0.5)
    at = _int(knot) / _KNOTS_PER_UNIT - _END
    h, square = x - at, at * at
    series = (square * (square - 6.0) + 3.0) * (h / 5.0)
    series = (series - at * (square - 3.0)) * (h / 4.0)
    series = (series + square - 1.0) * (h / 3.0)
    series = (series - at) * (h / 2.0)
    return _NORMAL[knot] + _DENSITY[knot] * h * (1.0 + series)


@program
def class_probabilities(belief: Any, bounds: Any, found: Any) -> None:
    """Probability of each class of each cell.

    Args:
        bounds: Upper bounds of all classes but the last, ascending, float64 [classes - 1].
        found: Result, float64 [classes, cells].
    """
    for cell in range(len(belief.mean)):
        mean, deviation, before = belief.mean[cell], belief.deviation[cell], 0.0
        if np.isnan(mean):
            found[:, cell] = np.nan
            continue
        for number in range(len(bounds)):
            share = below(bounds[number], mean, deviation)
            found[number, cell] = share - before
            before = share
        found[len(bounds), cell] = 1.0 - before

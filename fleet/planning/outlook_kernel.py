"""The compiled form of `fleet.planning.interest`, for parts of the field; see `fleet.planning.outlook`."""

from __future__ import annotations

from math import exp, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fleet.compiled import part, program
from fleet.functions.kriging_kernel import TILE, below
from fleet.planning.interest import REACH

_int: Any = np.int64  # Any: numba's integers are not numpy's to a type checker
SIDE = 2
"""Rows and columns to the farthest cells that make a place rich: it is the mean over 5 x 5."""
START = 6.0
"""Moves that the way to a rich place counts for, however short it is."""
_SPARSE = 4
"""Of a tile far away the doubt in every fourth cell of every fourth row says how rich it may be."""
_MOST_DOUBT, _SOME_DOUBT = 0.76, 0.1
"""A little more than the doubt between four classes can be; and what it is where it was not asked for."""


class Sketch(NamedTuple):
    """Room for what is seen of the field; only what was just seen means anything.

    Args:
        doubt: Doubt about each cell, with a margin of zeros, float64 [rows + 6, columns + 6].
        interest: Interest of each cell, with a margin of zeros, float64 [rows + 4, columns + 4].
        line: Doubt around the cells of one row, float64 [columns].
        claimed: How many others are about to capture each cell, int32 [cells].
        listed: Tiles that may be rich, int64 [tiles].
        score: How rich they may be for the way there, float64 [tiles].
    """

    doubt: NDArray[np.float64]
    interest: NDArray[np.float64]
    line: NDArray[np.float64]
    claimed: NDArray[np.int32]
    listed: NDArray[np.int64]
    score: NDArray[np.float64]


class Wishes(NamedTuple):
    """What makes a cell interesting.

    Args:
        doubt, doubt_around, novelty: Weights.
        equal: Whether it is too early for that, and all free cells are alike.
        bounds: Upper bounds of all classes but the last, ascending, float64 [classes - 1].
        around: Share of each cell around, float64 [7, 7].
        fall: By how much novelty's exponent falls with a distance of a cell's width.
    """

    doubt: float
    doubt_around: float
    novelty: float
    equal: bool
    bounds: NDArray[np.float64]
    around: NDArray[np.float64]
    fall: float


@part
def doubt_of(belief: Any, cell: Any, bounds: Any) -> Any:
    """Probability that the believed class of a cell is wrong; 0 when it is captured or has no data."""
    doubt = 0.0
    if belief.free[cell]:
        before, most = 0.0, 0.0
        for number in range(len(bounds)):
            share = below(bounds[number], belief.mean[cell], belief.deviation[cell])
            most = max(most, share - before)
            before = share
        doubt = 1.0 - max(most, 1.0 - before)
    return doubt


@part
def _novelty(belief: Any, cell: Any, fall: Any) -> Any:
    """1 - exp(-d / 3), with d the distance to the nearest captured cell."""
    places, nearest = belief.places, belief.near[cell, 0]
    down = _int(places.row[cell]) - places.row[nearest]
    right = _int(places.column[cell]) - places.column[nearest]
    return 1.0 - exp(-sqrt(down * down * places.aspect + right * right) * fall)


@part
def _doubt_in(belief: Any, sketch: Any, wishes: Any, rect: Any) -> None:
    """Write the doubt about the cells of a part, and of the cells around them."""
    rows, columns = belief.places.covariance.shape
    top, bottom, left, right = rect
    for row in range(max(top - REACH, 0), min(bottom + REACH, rows)):
        for column in range(max(left - REACH, 0), min(right + REACH, columns)):
            sketch.doubt[row + REACH, column + REACH] = doubt_of(belief, row * columns + column, wishes.bounds)


@part
def _around_in(sketch: Any, wishes: Any, row: Any, left: Any, right: Any) -> None:
    """Write the doubt around the cells of a part of a row."""
    for column in range(left, right):
        sketch.line[column] = 0.0
    for down in range(2 * REACH + 1):
        for across in range(2 * REACH + 1):
            share = wishes.around[down, across]
            for column in range(left, right):
                sketch.line[column] += share * sketch.doubt[row + down, column + across]


@part
def _see(belief: Any, sketch: Any, wishes: Any, rect: Any) -> None:
    """Write the interest of the cells of a part of the field: rows `top` to `bottom`, columns `left` to `right`."""
    top, bottom, left, right = rect
    columns = belief.places.covariance.shape[1]
    if not wishes.equal:
        _doubt_in(belief, sketch, wishes, rect)
    for row in range(top, bottom):
        if not wishes.equal:
            _around_in(sketch, wishes, row, left, right)
        for column in range(left, right):
            cell, total = row * columns + column, 0.0
            if belief.free[cell] and sketch.claimed[cell] == 0:
                if wishes.equal:
                    total = 0.5
                else:
                    total = wishes.doubt * sketch.doubt[row + REACH, column + REACH]
                    total += wishes.doubt_around * sketch.line[column]
                    total += wishes.novelty * _novelty(belief, cell, wishes.fall)
            sketch.interest[row + SIDE, column + SIDE] = total


@part
def _collect(sketch: Any, rect: Any, found: Any, count: Any) -> Any:
    """Add the interest of cells of a part that have any to those that were found; their number."""
    top, bottom, left, right = rect
    for row in range(top, bottom):
        for column in range(left, right):
            value = sketch.interest[row + SIDE, column + SIDE]
            if value > 0.0:
                found[count] = value
                count += 1
    return count


@program
def look(belief: Any, sketch: Any, wishes: Any, parts: Any, found: Any) -> Any:
    """See parts of the field, the last of which is not sampled.

    Args:
        parts: First and last row and column of each, the last ones excluded, int64 [parts, 4].
        found: Result, the interest of all cells of the sampled parts that have any, float64 [cells].

    Returns:
        How many there are.
    """
    count = _int(0)
    for index in range(len(parts)):
        rect = (parts[index, 0], parts[index, 1], parts[index, 2], parts[index, 3])
        _see(belief, sketch, wishes, rect)
        if index < len(parts) - 1:
            count = _collect(sketch, rect, found, count)
    return count


@part
def _richest_in(sketch: Any, rect: Any, start: Any, best: Any) -> Any:
    """The cell of a part around which there is most interest for the way there, when that is more than the best yet.

    Args:
        rect: Seen, and the cells around it too.
        start: Row and column of the agent.
        best: Score and number of the best cell yet.
    """
    score, cell = best
    top, bottom, left, right = rect
    columns = sketch.line.shape[0]
    for row in range(top, bottom):
        for column in range(left, right):
            way = abs(row - start[0]) + abs(column - start[1])
            if way == 0 or sketch.interest[row + SIDE, column + SIDE] <= 0.0:
                continue
            total = 0.0
            for down in range(2 * SIDE + 1):
                for across in range(2 * SIDE + 1):
                    total += sketch.interest[row + down, column + across]
            if total / (way + START) > score:
                score, cell = total / (way + START), row * columns + column
    return score, cell


@part
def _of_tile(belief: Any, row: Any, column: Any) -> Any:
    """The part of the field that a tile is."""
    rows, columns = belief.places.covariance.shape
    return row * TILE, min((row + 1) * TILE, rows), column * TILE, min((column + 1) * TILE, columns)


@part
def _way_to(rect: Any, start: Any) -> Any:
    """Least number of moves to a part of the field."""
    top, bottom, left, right = rect
    down = max(top - start[0], start[0] - bottom + 1, 0)
    return down + max(left - start[1], start[1] - right + 1, 0)


@part
def _estimate(belief: Any, wishes: Any, rect: Any, free: Any) -> Any:
    """About how much doubt there is in a cell of a tile with so many free cells."""
    top, bottom, left, right = rect
    columns, total, count = belief.places.covariance.shape[1], 0.0, 0
    for row in range(top, bottom, _SPARSE):
        for column in range(left, right, _SPARSE):
            total += doubt_of(belief, row * columns + column, wishes.bounds)
            count += belief.free[row * columns + column]
    mean = total / count if count > 0 else _SOME_DOUBT
    return mean * free / ((bottom - top) * (right - left))


@part
def _list(sketch: Any, count: Any, score: Any, tile: Any) -> Any:
    """Put a tile among the listed ones, best first; how many there are now."""
    at = count
    while at > 0 and sketch.score[at - 1] < score:
        at -= 1
    if at < len(sketch.listed):
        count = min(count + 1, len(sketch.listed))
        for place in range(count - 1, at, -1):
            sketch.listed[place], sketch.score[place] = sketch.listed[place - 1], sketch.score[place - 1]
        sketch.listed[at], sketch.score[at] = tile, score
    return count


@program
def promising(belief: Any, sketch: Any, wishes: Any, start: Any) -> Any:
    """List tiles that may be rich for the way there, in rings around the agent's own, until none beyond can be richer.

    Args:
        start: Row and column of the agent.

    Returns:
        How many are listed, the best first.
    """
    rows, columns = belief.left.shape
    home, count, ring = (start[0] // TILE, start[1] // TILE), _int(0), _int(0)
    while ring < max(rows, columns) and (
        count == 0 or _MOST_DOUBT / (max(ring - 1, 0) * TILE + 1 + START) > sketch.score[0]
    ):
        for row in range(max(home[0] - ring, 0), min(home[0] + ring + 1, rows)):
            stride = 1 if abs(row - home[0]) == ring else max(2 * ring, 1)
            for column in range(home[1] - ring, home[1] + ring + 1, stride):
                if 0 <= column < columns and belief.left[row, column] > 0:
                    rect = _of_tile(belief, row, column)
                    score = _estimate(belief, wishes, rect, belief.left[row, column]) / (_way_to(rect, start) + START)
                    count = _list(sketch, count, score, row * columns + column)
        ring += 1
    return count


@program
def richest(belief: Any, sketch: Any, wishes: Any, start: Any, tiles: Any) -> Any:
    """The cell in some tiles around which there is most interest for the way there; -1 when there is no interest.

    Args:
        start: Row and column of the agent.
        tiles: Their numbers, int64 [tiles].
    """
    rows, columns = belief.places.covariance.shape
    best = (0.0, _int(-1))
    for index in range(len(tiles)):
        rect = _of_tile(belief, tiles[index] // belief.left.shape[1], tiles[index] % belief.left.shape[1])
        top, bottom, left, right = rect
        _see(
            belief,
            sketch,
            wishes,
            (max(top - SIDE, 0), min(bottom + SIDE, rows), max(left - SIDE, 0), min(right + SIDE, columns)),
        )
        best = _richest_in(sketch, rect, start, best)
    return best[1]


@program
def sureness(belief: Any, bounds: Any, cells: Any, found: Any) -> Any:
    """Probability of the believed class of each of some cells that are free.

    Args:
        bounds: As in `Wishes`.
        cells: Cell numbers, int64 [n].
        found: Result, float64 [n].

    Returns:
        How many are free.
    """
    count = _int(0)
    for index in range(len(cells)):
        if belief.free[cells[index]]:
            found[count] = 1.0 - doubt_of(belief, cells[index], bounds)
            count += 1
    return count

"""The compiled form of `bench.greedy.meadow`.

What makes it fast: no map is kept. A step predicts only the free cells beside the agent, each from the 8 nearest of the
captured cells, which are found by looking outwards from it.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fleet.compiled import part, program
from fleet.functions.compiled_kriging import Scratch, Steps
from fleet.functions.kriging_kernel import below, expect, look
from fleet.functions.local_kriging import Places

_int: Any = np.int64  # Any: numba's integers are not numpy's to a type checker
_word: Any = np.uint64
MOVES = 4
FEATURES = 5


class Ground(NamedTuple):
    """What is flown over: a field with a border of cells without data, and the margin of `steps` around that.

    Agents are at places, which are numbered with the margin; what is known of a cell has its number without.

    Args:
        free: Places with data, uint8 [places].
        number: Of the cell in each place, int32 [places]; -1 in the margin.
        values: What is found in each cell, float64 [cells].
        size: How many cells have data.
        places, variance: How alike cells are.
        steps: Ways to the places around, by distance.
        ways: What each move adds to a place, int64 [4].
        compass: Moves one row down, one row up, one column on, one column back, int64 [4].
        costs: Energy of each move, as a share of their mean, float64 [4].
    """

    free: NDArray[np.uint8]
    number: NDArray[np.int32]
    values: NDArray[np.float64]
    size: int
    places: Places
    variance: float
    steps: Steps
    ways: NDArray[np.int64]
    compass: NDArray[np.int64]
    costs: NDArray[np.float64]


class Sky(NamedTuple):
    """What changes in a mission.

    Args:
        free, known: Places that can be captured, and places that are, uint8 [places].
        at, last, target: Of each agent, int64 [N]: where it is, its last move or -1, and where it flies to or -1.
        near: Room for neighbours, int32 [8].
        scratch: Room for a prediction.
        ssv: Room for the features of a move, float64 [5].
        bounds: Upper bounds of classes, ascending, float64 [3].
        total: Sum of the values of the captured cells, float64 [1].
        captured: Their number, int64 [1].
    """

    free: NDArray[np.uint8]
    known: NDArray[np.uint8]
    at: NDArray[np.int64]
    last: NDArray[np.int64]
    target: NDArray[np.int64]
    near: NDArray[np.int32]
    scratch: Scratch
    ssv: NDArray[np.float64]
    bounds: NDArray[np.float64]
    total: NDArray[np.float64]
    captured: NDArray[np.int64]


@part
def _capture(ground: Any, sky: Any, agent: Any) -> None:
    """Capture the cell in which an agent is, if it is free."""
    cell = _word(sky.at[agent])
    if sky.free[cell]:
        sky.free[cell] = 0
        sky.known[cell] = 1
        sky.total[0] += ground.values[ground.number[cell]]
        sky.captured[0] += 1
        mean = sky.total[0] / sky.captured[0]
        for index in range(3):
            share = 0.8 + 0.1 * (index if mean >= 0.0 else 2 - index)
            sky.bounds[index] = share * mean


@part
def _open(sky: Any, ways: Any, cell: Any) -> Any:
    """Share of the cells beside a cell that can be captured."""
    count = 0
    for move in range(MOVES):
        count += _int(sky.free[_word(cell + ways[move])])
    return count / 4.0


@part
def _doubt(sky: Any, mean: Any, deviation: Any) -> Any:
    """Probability that the most probable class is wrong."""
    before, most = 0.0, 0.0
    for index in range(3):
        share = below(sky.bounds[index], mean, deviation)
        most = max(most, share - before)
        before = share
    return 1.0 - max(most, 1.0 - before)


@part
def _features(ground: Any, sky: Any, agent: Any, move: Any) -> None:
    """Write the SSV of the state that a move leads to; see `bench.greedy.meadow.FEATURES`."""
    cell = sky.at[agent] + ground.ways[move]
    number = ground.number[_word(cell)]
    found, _ = look(sky.known, cell, number, ground.steps, 0, sky.near)
    doubt, share = 0.75, 1.0
    if found > 0:
        mean, share = expect(sky.near, found, number, (ground.values, ground.places), sky.scratch)
        doubt = _doubt(sky, mean, sqrt(share * ground.variance))
    sky.ssv[0] = doubt
    sky.ssv[1] = sqrt(share)
    sky.ssv[2] = _open(sky, ground.ways, cell)
    sky.ssv[3] = 1.0 if move == sky.last[agent] else 0.0
    sky.ssv[4] = ground.costs[move]


@part
def _best(ground: Any, sky: Any, weights: Any, agent: Any) -> Any:
    """The move to a free cell whose weighted features are most, the first of equals; -1 when there is none."""
    best, most = _int(-1), -np.inf
    for move in range(MOVES):
        if sky.free[_word(sky.at[agent] + ground.ways[move])]:
            _features(ground, sky, agent, move)
            score = 0.0
            for index in range(FEATURES):
                score += weights[index] * sky.ssv[index]
            if score > most:
                best, most = move, score
    return best


@part
def _nearest_free(ground: Any, sky: Any, cell: Any) -> Any:
    """The nearest cell that can be captured, the first of equals; far away the first of the field."""
    for step in range(len(ground.steps.way)):
        found = cell + ground.steps.way[step]
        if sky.free[_word(found)]:
            return found
    for found in range(len(sky.free)):
        if sky.free[found]:
            return found
    return _int(-1)


@part
def _on_the_way(ground: Any, sky: Any, agent: Any) -> Any:
    """The move towards an agent's target along the longer way that is left; it gets one if it has none."""
    here = sky.at[agent]
    if sky.target[agent] < 0 or not sky.free[_word(sky.target[agent])]:
        sky.target[agent] = _nearest_free(ground, sky, here)
    number, target, places = ground.number[here], ground.number[sky.target[agent]], ground.places
    down = _int(places.row[target]) - places.row[number]
    across = _int(places.column[target]) - places.column[number]
    vertical = 0 if down > 0 else 1
    return ground.compass[vertical if abs(down) >= abs(across) else 2 if across > 0 else 3]


@program
def fly(ground: Any, sky: Any, starts: Any, weights: Any, path: Any) -> None:
    """Fly missions, move by move of one agent after the other, until all is captured or there is no room for the path.

    Args:
        starts: Where agents take off, int64 [N].
        weights: Of the features, float64 [M, 5].
        path: Result, cell numbers of the field in the order of flight, int32 [M, N, moves + 1]; -1 after the end.
    """
    agents = len(starts)
    for mission in range(len(weights)):
        for place in range(len(sky.free)):
            sky.free[place], sky.known[place] = ground.free[place], 0
        sky.total[0] = 0.0
        sky.captured[0] = 0
        for agent in range(agents):
            sky.at[agent], sky.last[agent], sky.target[agent] = starts[agent], -1, -1
            _capture(ground, sky, agent)
            path[mission, agent, 0] = ground.number[starts[agent]]
        step = 1
        while step < path.shape[2] and sky.captured[0] < ground.size:
            for agent in range(agents):
                if sky.captured[0] < ground.size:
                    move = _best(ground, sky, weights[mission], agent)
                    if move < 0:
                        move = _on_the_way(ground, sky, agent)
                    sky.last[agent] = move
                    sky.at[agent] += ground.ways[move]
                    _capture(ground, sky, agent)
                    path[mission, agent, step] = ground.number[sky.at[agent]]
            step += 1

"""Runs every program of every kernel on something tiny: `python -m tests.kernels` prints what came out, as digests."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from fleet.contexts.grid import Grid
from fleet.functions import compiled_kriging
from fleet.functions.belief import Belief
from fleet.functions.kriging import Variogram, places_of
from fleet.missions.layout import plan_layout
from fleet.planning.calibration import Calibration, expected_accuracy
from fleet.planning.outlook import Outlook
from fleet.planning.paths import PathFinder
from fleet.planning.tactics import InterestWeights, Search
from fleet.simulator.batch import Batch, fly
from fleet.spec.swarm import Agents, Groups, StateSpace
from tests.planning import ENERGY

GRID = Grid(np.ones((9, 11), dtype=np.bool_), 3.0, 2.0)
VALUES = np.random.default_rng(1).normal(100.0, 9.0, size=GRID.cells)
CELLS = np.random.default_rng(2).permutation(GRID.cells)[:40]
VARIOGRAM = Variogram(6.0, 0.1, 80.0)


def flown() -> Iterator[Any]:
    """`simulator.kernel`: two agents with chance moves, in groups that they leave early and that they search."""
    layout = plan_layout(GRID, StateSpace(context="field", groups=Groups(rows=4, columns=4)), Agents(count=2).resolved)
    generator = np.random.default_rng(3)
    batch = Batch(
        scores=generator.normal(size=(2, GRID.cells, 8)),
        table=np.array([[0, 1], [1, 0], [1, 1]]),
        rewards=generator.random((1, GRID.cells)),
        reward_of=np.zeros(3, dtype=np.int64),
        utility_thresholds=np.array([2.0, 4.0, 100.0]),
        visited_thresholds=np.array([4, 30, 100]),
        exploration=np.array([0.0, 0.3, 1.0]),
        missions=np.arange(3),
        seed=2**64 - 3,
    )
    result = fly(layout, batch, traced=True)
    trace = result.trace
    yield from (result.captured, result.moves, result.captures, result.decisions, result.steps, result.groups_explored)
    if trace is not None:
        yield from (trace.cell, trace.captured, trace.legal, trace.move)


def kriged() -> Iterator[Any]:
    """`functions.kriging_kernel`, from scratch and cell by cell."""
    known = np.zeros(GRID.cells, dtype=np.bool_)
    known[CELLS] = True
    targets = np.flatnonzero(~known).astype(np.int32)
    near = compiled_kriging.nearest(known.reshape(GRID.valid.shape), targets, GRID, 8)
    yield near
    yield compiled_kriging.solve(near, targets, VALUES, places_of(GRID, VARIOGRAM))
    belief = Belief(GRID, VARIOGRAM)
    for start in range(0, len(CELLS), 5):
        belief.observe(CELLS[start : start + 5], VALUES[CELLS[start : start + 5]])
    yield belief.class_probabilities()


def planned() -> Iterator[Any]:
    """`planning.kernel` and `planning.outlook_kernel`."""
    interest = np.abs(VALUES - 100.0).reshape(GRID.valid.shape)
    interest.reshape(-1)[CELLS] = 0.0
    finder = PathFinder(GRID, ENERGY, Search(horizon=6, width=8))
    yield from (finder.best(interest, 40, last, 0.001) for last in range(-1, 4))
    belief = Belief(GRID, VARIOGRAM)
    belief.observe(CELLS, VALUES[CELLS])
    outlook = Outlook(belief, horizon=3)
    view = outlook.view(40, InterestWeights())
    yield from (view.interest, view.typical, outlook.richest(40, InterestWeights()))
    yield expected_accuracy(belief, Calibration())


def digests() -> dict[str, str]:
    """What each kernel's results come down to, bit by bit."""
    found = {}
    for form in (flown, kriged, planned):
        digest = hashlib.sha256()
        for each in form():
            digest.update(np.asarray(each).tobytes())
        found[form.__name__] = digest.hexdigest()[:16]
    return found


if __name__ == "__main__":
    print(digests())  # noqa: T201 - the test reads it

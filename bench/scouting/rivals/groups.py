"""Plans of the paper's scaffold, flown by the platform's own simulator: moves are chosen cell by cell in state groups.

`Groups` visits 3x3 groups in serpentine order, captures V cells of each, and moves at random: what is left of the
published swarm when its learning is taken away. `ClassicRL` is the prior work that the paper compares with: no groups,
and in every cell the move that led to the most in similar cells of other fields. Source: Zhang et al. 2020, Whole-Field
Reinforcement Learning: A Fully Autonomous Aerial Scouting Method for Precision Agriculture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bench.scouting.fields import CORN, NOISE, REAL, Field, field, noise, planted
from bench.scouting.flight import Flights, flown
from fleet.contexts.grid import Grid
from fleet.missions.layout import MOVES, Layout, divide, plan_layout
from fleet.missions.partition import parts
from fleet.simulator.batch import Batch, fly
from fleet.spec.swarm import CARDINAL, Agents, StateSpace

Values = NDArray[np.float64]
_GROUP_CELLS = 9
_OTHER_SEED = 1_000_003
"""Of the made-up field that is known before another one is flown."""
_MOVES = tuple(MOVES.index(action) for action in CARDINAL)


@dataclass(frozen=True)
class Groups:
    """Random moves in 3x3 groups; the budget is the share of each group's cells.

    Args:
        whole_path: Whether cells on the way to the next group are captured too.
    """

    whole_path: bool = False

    @property
    def name(self) -> str:
        """For tables."""
        return "3x3 groups, random moves" + (", whole path" if self.whole_path else "")

    def budgets(self, place: Field) -> Sequence[float]:
        """One cell of every fourth, third and second group, and one to nine of each."""
        return tuple(cells / _GROUP_CELLS for cells in (1 / 4, 1 / 3, 1 / 2, *range(1, _GROUP_CELLS + 1)))

    def fly(self, place: Field, agents: int, seed: int, budget: float | None) -> Flights:
        """Fly to some cells of each group, to all when there is no budget."""
        space = StateSpace(context="field", capture_in_transit=self.whole_path)
        layout = plan_layout(place.grid, space, Agents(count=agents).resolved)
        cells = (1.0 if budget is None else budget) * _GROUP_CELLS
        if cells < 1:
            layout = _thinned(layout, round(1 / cells))
        return _flights(layout, np.zeros((place.grid.cells, len(MOVES))), (max(1, round(cells)), 1.0, seed))


@dataclass(frozen=True)
class ClassicRL:
    """k nearest neighbours choose the move: what it led to in the k most similar cells of the fields that are known.

    A cell is known by its value, in standard deviations from the field's mean; a move leads to as much as the next
    cell's value differs. The flown field is not among those that are known, but its mean and deviation are, which is
    in favour of this plan.

    Args:
        neighbours: k.
    """

    name: str = "k-NN Classic RL"
    neighbours: int = 5

    def budgets(self, place: Field) -> Sequence[float]:
        """None: it flies on until nothing is left of its part."""
        return ()

    def fly(self, place: Field, agents: int, seed: int, budget: float | None) -> Flights:
        """Fly until every cell is captured."""
        generator = np.random.default_rng(seed)
        groups = parts(place.grid, agents)
        group_of = np.full(place.grid.cells, -1, dtype=np.int64)
        for index, cells in enumerate(groups):
            group_of[cells] = index
        layout = Layout(
            grid=place.grid,
            groups=groups,
            group_of=group_of,
            parts=tuple((agent, agent + 1) for agent in range(agents)),
            starts=tuple(int(generator.choice(cells)) for cells in groups),
            actions=(_MOVES,) * agents,
            capture_in_transit=True,
        )
        return _flights(layout, self._scores(place), (place.grid.cells, 0.0, seed))

    def _scores(self, place: Field) -> Values:
        """What each move promises in each cell, float64 [cells, 8]."""
        scores = np.zeros((place.grid.cells, len(MOVES)))
        known = [_standard(other) for other in others(place.name)]
        here = _standard(place)[0].reshape(-1)
        valid = np.flatnonzero(place.grid.valid)
        for move in _MOVES:
            before, gains = (
                np.concatenate(part) for part in zip(*(_led_to(*each, move) for each in known), strict=True)
            )
            _, near = cKDTree(before[:, None]).query(here[valid, None], k=self.neighbours)
            scores[valid, move] = gains[near].mean(axis=1)
        return scores


def _thinned(layout: Layout, step: int) -> Layout:
    """The same with one group out of some, as many at least as there are agents."""
    groups = layout.groups[:: max(1, min(step, len(layout.groups) // layout.agents))]
    group_of = np.full(layout.grid.cells, -1, dtype=np.int64)
    for index, cells in enumerate(groups):
        group_of[cells] = index
    shares = divide([len(cells) for cells in groups], layout.agents)
    starts = tuple(int(groups[first][0]) for first, _ in shares)
    return replace(layout, groups=groups, group_of=group_of, parts=shares, starts=starts)


def others(name: str) -> list[Field]:
    """The fields that are known before one is flown: never itself; other dates of the same field when it has them."""
    if name in CORN:
        return [field(date) for date in CORN if date != name]
    if name in REAL:
        return [field(other) for other in REAL if other != name]
    return [Field((noise if name.startswith(NOISE) else planted)(_OTHER_SEED))]


def _standard(place: Field) -> tuple[Values, Grid]:
    """Values in standard deviations from the mean, [rows, columns], and their grid."""
    found = place.truth[place.cells]
    values = (place.truth - found.mean()) / found.std()
    return values.reshape(place.grid.rows, place.grid.columns), place.grid


def _led_to(values: Values, grid: Grid, move: int) -> tuple[Values, Values]:
    """Value before each possible move in one direction, and by how much it changed, [n]."""
    down, across = grid.step(MOVES[move])
    padded = np.pad(values, 1, constant_values=np.nan)
    after = padded[1 + down : 1 + down + grid.rows, 1 + across : 1 + across + grid.columns]
    both = np.isfinite(values) & np.isfinite(after)
    return values[both], np.abs(after - values)[both]


def _flights(layout: Layout, scores: Values, how: tuple[int, float, int]) -> Flights:
    """One mission with a score table; `how` is cells to visit in a group, share of random moves, and the seed.

    An agent leaves a group when it has visited more cells than the threshold says.
    """
    visited, exploration, seed = how
    batch = Batch(
        scores=np.where(layout.grid.valid.reshape(-1, 1), scores, 0.0)[None],
        table=np.zeros((1, layout.agents), dtype=np.int64),
        rewards=np.zeros((1, layout.grid.cells)),
        reward_of=np.zeros(1, dtype=np.int64),
        utility_thresholds=np.full(1, np.inf),
        visited_thresholds=np.full(1, visited - 1, dtype=np.int64),
        exploration=np.full(1, exploration),
        missions=np.zeros(1, dtype=np.int64),
        seed=seed,
    )
    trace = fly(layout, batch, traced=True).trace
    assert trace is not None
    steps = trace.steps[0].tolist()
    return tuple(
        flown(layout.grid, trace.cell[0, agent, :count].astype(np.int64), trace.captured[0, agent, :count])
        for agent, count in enumerate(steps)
    )

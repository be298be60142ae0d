"""Many missions over one layout at once, and what became of them.

Agents of a mission do not touch each other: each has its own groups, its own memory of captured states, and its own
random draws. So flying agent after agent is the same as flying all of them in lock-step, and lets one flight's state
stay in the processor's nearest cache.

Time is linear in the states that are visited, with two additions: travelling to the nearest state that is left in a
group looks through that group once, and an agent passes each of its groups once. With groups of bounded size a mission
is linear in the cells of its grid; nothing is ever done for cells that no agent visits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.energy.accounting import FlightCounts
from fleet.errors import MissionError
from fleet.missions.layout import MOVES, Layout

Finished = Callable[[int, int, NDArray[np.bool_]], bool]
"""Eval() in flight: from the mission's index, the agent's index and the cells [cells] that this agent has captured.

It must depend on these alone. It is asked in the order of missions, then agents, then time.
"""


@dataclass(frozen=True, eq=False)
class Batch:
    """M missions of N agents, and the policies that they fly with.

    Args:
        scores: P tables with SA's score of each of MOVES in each cell, float64 [P, cells, 8]; rows of cells without
            data are never read.
        table: Table of each agent, int64 [M, N].
        rewards: R tables with the reward of a transition into each cell, float64 [R, cells]; likewise.
        reward_of: Reward table of each mission, int64 [M].
        utility_thresholds: T_u of each mission, float64 [M].
        visited_thresholds: T_v of each mission, int64 [M].
        exploration: Share of random choices in each mission, float64 [M].
        missions: Number of each mission for the random draws, int64 [M].
        seed: With a mission's number it fixes all random choices of the mission.
    """

    scores: NDArray[np.float64]
    table: NDArray[np.int64]
    rewards: NDArray[np.float64]
    reward_of: NDArray[np.int64]
    utility_thresholds: NDArray[np.float64]
    visited_thresholds: NDArray[np.int64]
    exploration: NDArray[np.float64]
    missions: NDArray[np.int64]
    seed: int = 0

    def __len__(self) -> int:
        return len(self.missions)

    def check(self, layout: Layout) -> None:
        """Whether the arrays fit each other and a layout.

        Raises:
            MissionError: says which array does not, and what was expected.
        """
        missions, cells = len(self.missions), layout.grid.cells
        expected: dict[str, tuple[int, ...]] = {
            "scores": (len(self.scores), cells, len(MOVES)),
            "table": (missions, layout.agents),
            "rewards": (len(self.rewards), cells),
            "reward_of": (missions,),
            "utility_thresholds": (missions,),
            "visited_thresholds": (missions,),
            "exploration": (missions,),
            "missions": (missions,),
        }
        for name, shape in expected.items():
            found = getattr(self, name).shape
            if found != shape:
                raise MissionError(f"batch: {name} has the shape {found}, but {shape} fits the layout and the missions")
        for name, tables in (("table", len(self.scores)), ("reward_of", len(self.rewards))):
            indices = getattr(self, name)
            if indices.size and not (indices.min() >= 0 and indices.max() < tables):
                raise MissionError(f"batch: {name} must be in 0..{tables - 1}")


@dataclass(frozen=True, eq=False)
class Trace:
    """Every visited state of every flight, in order; the M x N flights are padded to the longest, S.

    Args:
        cell: State, int32 [M, N, S]; -1 after the end.
        captured: Whether it was captured in this visit, bool [M, N, S].
        legal: Bit i is set when SA could choose MOVES[i], uint8 [M, N, S]; 0 when SA was not asked.
        move: Index into MOVES, int8 [M, N, S]; -1 for landing, and after the end.
        steps: Length of each flight, int64 [M, N].
    """

    cell: NDArray[np.int32]
    captured: NDArray[np.bool_]
    legal: NDArray[np.uint8]
    move: NDArray[np.int8]
    steps: NDArray[np.int64]

    @staticmethod
    def blank(missions: int, agents: int, steps: int) -> Trace:
        """A trace of padding."""
        shape = (missions, agents, steps)
        return Trace(
            cell=np.full(shape, -1, dtype=np.int32),
            captured=np.zeros(shape, dtype=np.bool_),
            legal=np.zeros(shape, dtype=np.uint8),
            move=np.full(shape, -1, dtype=np.int8),
            steps=np.zeros((missions, agents), dtype=np.int64),
        )


@dataclass(frozen=True, eq=False)
class Flown:
    """What M missions of N agents did.

    Args:
        captured: Cells that any agent of a mission captured, bool [M, cells].
        moves: How often each agent made each of MOVES, int64 [M, N, 8].
        captures: States captured by each agent, int64 [M, N].
        decisions: States in which SA was asked, int64 [M, N].
        steps: States visited, the take-off cell included, int64 [M, N].
        groups_explored: Groups of each agent's part that are behind it, int64 [M, N].
        trace: Every visited state, when asked for.
    """

    captured: NDArray[np.bool_]
    moves: NDArray[np.int64]
    captures: NDArray[np.int64]
    decisions: NDArray[np.int64]
    steps: NDArray[np.int64]
    groups_explored: NDArray[np.int64]
    trace: Trace | None = None

    @staticmethod
    def blank(missions: int, agents: int, cells: int) -> Flown:
        """Missions that have done nothing yet."""

        def counts() -> NDArray[np.int64]:
            return np.zeros((missions, agents), dtype=np.int64)

        return Flown(
            captured=np.zeros((missions, cells), dtype=np.bool_),
            moves=np.zeros((missions, agents, len(MOVES)), dtype=np.int64),
            captures=counts(),
            decisions=counts(),
            steps=counts(),
            groups_explored=counts(),
        )

    def counts(self, mission: int, agent: int) -> FlightCounts:
        """What one flight did, for accounting."""
        return FlightCounts(
            moves=tuple(self.moves[mission, agent].tolist()),
            captures=int(self.captures[mission, agent]),
            decisions=int(self.decisions[mission, agent]),
            steps=int(self.steps[mission, agent]),
        )


def broken_table(table: int) -> MissionError:
    """The error for a table that lacks a score."""
    return MissionError(f"batch: score table {table} has NaN for a move in a cell with data; SA must score every move")


def fly(layout: Layout, batch: Batch, traced: bool = False, finished: Finished | None = None) -> Flown:
    """Fly all missions of a batch to their end, on one core, exactly as `fleet.missions.flight.Flight` would.

    Args:
        layout: Who flies where; the same for all missions.
        batch: The missions.
        traced: Whether the result has every visited state.
        finished: Asked whenever an agent leaves a group and has another one before it; True lands that agent there.

    Raises:
        MissionError: the batch does not fit the layout, or has no score where one may be needed.
    """
    batch.check(layout)
    from fleet.simulator import fast  # noqa: PLC0415 - numba loads only in roles that fly

    return fast.fly(layout, batch, traced, finished)

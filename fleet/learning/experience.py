"""What SA learns from: the moves it chose, from the log of a flown mission and from the trace of simulated ones.

A transition starts where SA was asked (a legal move was there) and ends in the next visited state. Travel between
groups is HA's and the layout's, not SA's: it is no transition, and an episode ends before it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fleet.learning.model import Transitions
from fleet.learning.reward import RewardModel
from fleet.missions.layout import MOVES
from fleet.missions.records import Record


class Traced(Protocol):
    """The steps of simulated missions, each array [missions, agents, steps]; cells after the end are -1.

    The same as `simulator.batch.Trace`.
    """

    @property
    def cell(self) -> NDArray[np.int32]:
        """The state of each step."""

    @property
    def legal(self) -> NDArray[np.uint8]:
        """Bit i is set when SA could choose MOVES[i]."""

    @property
    def move(self) -> NDArray[np.int8]:
        """The move that left the state."""


@dataclass(frozen=True, eq=False)
class Choices:
    """Transitions by the numbers of their states.

    Args:
        cell, next_cell: State before and after the move, int64 [n].
        move: Index into MOVES, int64 [n].
        next_legal: Bits of the moves that SA could choose next, uint8 [n].
    """

    cell: NDArray[np.int64]
    move: NDArray[np.int64]
    next_cell: NDArray[np.int64]
    next_legal: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.move)

    def sample(self, count: int, generator: np.random.Generator) -> Choices:
        """At most so many of them, drawn without replacement."""
        if len(self) <= count:
            return self
        kept = generator.choice(len(self), count, replace=False, shuffle=False)
        return Choices(self.cell[kept], self.move[kept], self.next_cell[kept], self.next_legal[kept])

    def transitions(self, ssv: NDArray[np.float64], rewards: NDArray[np.float64]) -> Transitions:
        """With the SSV [cells, features] and the reward [cells] of each state."""
        return Transitions(
            ssv[self.cell], self.move, rewards[self.next_cell], ssv[self.next_cell], legal_moves(self.next_legal)
        )


def legal_moves(bits: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Bits of legal moves, [n], as bool [n, len(MOVES)]."""
    return np.asarray((bits[:, None] >> np.arange(len(MOVES), dtype=np.uint8)) & 1, dtype=np.bool_)


def choices(trace: Traced) -> Choices:
    """Every choice of SA in a trace, mission by mission, agent by agent, step by step."""
    asked = (trace.legal[..., :-1] != 0) & (trace.cell[..., 1:] >= 0)
    return Choices(
        cell=trace.cell[..., :-1][asked].astype(np.int64),
        move=trace.move[..., :-1][asked].astype(np.int64),
        next_cell=trace.cell[..., 1:][asked].astype(np.int64),
        next_legal=trace.legal[..., 1:][asked],
    )


def from_trace(trace: Traced, ssv: NDArray[np.float64], rewards: NDArray[np.float64]) -> Transitions:
    """Transitions of simulated missions over one context.

    Args:
        trace: Steps of the missions.
        ssv: SSV of each state, float64 [cells, features].
        rewards: Reward of a transition into each state, float64 [cells].
    """
    return choices(trace).transitions(ssv, rewards)


def from_log(records: Sequence[Record], reward: RewardModel) -> Transitions:
    """Transitions of a flown mission, from one agent's log as far as it goes.

    The SSV of a state that is visited again is the one of its capture. A choice whose next state has no SSV, because
    the log ends there, does not count.
    """
    known: dict[int, tuple[float, ...]] = {}
    before: list[tuple[float, ...]] = []
    after: list[tuple[float, ...]] = []
    moves: list[int] = []
    bits: list[int] = []
    previous: Record | None = None
    for record in records:
        if record.captured:
            known[record.cell] = record.ssv
        if previous is not None and previous.legal and previous.cell in known and record.cell in known:
            before.append(known[previous.cell])
            after.append(known[record.cell])
            moves.append(previous.move)
            bits.append(record.legal)
        previous = record
    if not moves:
        return empty(len(reward.features))
    next_ssv = np.array(after, dtype=np.float64)
    return Transitions(
        ssv=np.array(before, dtype=np.float64),
        moves=np.array(moves, dtype=np.int64),
        rewards=reward.reward(next_ssv),
        next_ssv=next_ssv,
        next_legal=legal_moves(np.array(bits, dtype=np.uint8)),
    )


def from_logs(logs: Mapping[str, Sequence[Record]], reward: RewardModel) -> Transitions:
    """Transitions of several agents, in the order of their names."""
    parts = [from_log(logs[agent], reward) for agent in sorted(logs)]
    return concatenate(parts) if parts else empty(len(reward.features))


def empty(features: int) -> Transitions:
    """No transitions, for SSVs of so many features."""
    none = np.empty((0, features))
    return Transitions(none, np.empty(0, np.int64), np.empty(0), none, np.empty((0, len(MOVES)), np.bool_))


def concatenate(parts: Sequence[Transitions]) -> Transitions:
    """All transitions of one or more parts, in their order."""
    return Transitions(
        ssv=np.concatenate([part.ssv for part in parts]),
        moves=np.concatenate([part.moves for part in parts]),
        rewards=np.concatenate([part.rewards for part in parts]),
        next_ssv=np.concatenate([part.next_ssv for part in parts]),
        next_legal=np.concatenate([part.next_legal for part in parts]),
    )

"""The flight of one agent as a state machine: what to capture, when to leave a group, where to go next.

This is the plain form of a mission. The AS workflow flies it live, `simulator/reference.py` runs it over a context,
and the compiled kernel must give the same trace.

In each visited state: capture it if it has data and was not captured before; ask HA whether to leave the group
(U > T_u or V > T_v); if not, let SA choose among the legal moves, which stay in the group and lead to a state not yet
captured; if none is legal, travel to the nearest such state of the group. Left groups are never entered again on
purpose. When no group is left, land.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from fleet.missions.layout import MOVES, Layout
from fleet.randomness import draw, uniform
from fleet.spec.swarm import Action

LAND = -1
"""The move of the last state of a flight."""
_EXPLORE, _PICK = 0, 1


class HistoryToAction(Protocol):
    """HA: decides from the history of a state group whether to move on to the next."""

    def moves_on(self, utility: float, visited: int) -> bool:
        """True when the group is left; U and V of the paper."""


@dataclass(frozen=True)
class Decision:
    """What an agent does in one visited state.

    Args:
        step: 0 in the take-off cell.
        cell: The state.
        captured: Whether the state was captured in this visit.
        legal: Bit i is set when SA could choose MOVES[i]; 0 when SA was not asked.
        move: Index into MOVES, or LAND.
    """

    step: int
    cell: int
    captured: bool
    legal: int
    move: int


@dataclass(frozen=True)
class Arrival:
    """What there is to choose in the current state.

    Args:
        captured: Whether the state was captured in this visit.
        legal: Bit i is set when SA may choose MOVES[i]; 0 when SA is not asked.
        finished: What Eval() said here; None when it was not asked.
    """

    captured: bool
    legal: int
    finished: bool | None = None


@dataclass(frozen=True)
class Choice:
    """What was chosen among the legal moves.

    Args:
        move: Index into MOVES.
        explores: Whether it was drawn, whatever the scores.
    """

    move: int
    explores: bool


@dataclass(frozen=True)
class GroupHistory:
    """What HA decides from.

    Args:
        group: Index into the layout's groups.
        utility, visited: U and V of the paper.
        cells: States of the group.
    """

    group: int
    utility: float
    visited: int
    cells: int

    @property
    def is_whole(self) -> bool:
        """Whether every state is captured, so that the group is left without asking HA."""
        return self.visited == self.cells


@dataclass
class Flight:
    """State of one agent's mission; see the module's text.

    Args:
        layout: Who flies where.
        agent: Index of the agent.
        ha: When to leave a group.
        seed, mission: With the agent and the step, they fix all random choices.
        exploration: Share of random choices among the legal moves.
    """

    layout: Layout
    agent: int
    ha: HistoryToAction
    seed: int = 0
    mission: int = 0
    exploration: float = 0.0
    cell: int = field(init=False)
    step: int = field(init=False, default=0)
    group: int = field(init=False)
    landed: bool = field(init=False, default=False)
    captured: set[int] = field(init=False, default_factory=set)
    utility: dict[int, float] = field(init=False, default_factory=dict)
    visited: dict[int, int] = field(init=False, default_factory=dict)
    _target: int | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.cell = self.layout.starts[self.agent]
        self.group = self.layout.parts[self.agent][0]
        if self.layout.group_of[self.cell] != self.group:
            self._target = self._nearest_left(self.group)

    @property
    def groups_explored(self) -> int:
        """Groups of the agent's part that are behind it."""
        return self.group - self.layout.parts[self.agent][0]

    @property
    def target(self) -> int | None:
        """The cell that the agent travels to; None when it explores its group."""
        return self._target

    def history(self, group: int) -> GroupHistory:
        """What is behind the agent in a group."""
        cells = len(self.layout.groups[group])
        return GroupHistory(group, self.utility.get(group, 0.0), self.visited.get(group, 0), cells)

    def wants_capture(self) -> bool:
        """Whether the current state is to be sensed and mapped before `decide`."""
        has_data = bool(self.layout.group_of[self.cell] >= 0)
        passing = self._target is not None and self._target != self.cell
        return has_data and self.cell not in self.captured and (self.layout.capture_in_transit or not passing)

    def decide(
        self, scores: Callable[[], Sequence[float]], reward: float, finished: Callable[[], bool] | None = None
    ) -> Decision:
        """Account for the current state, choose the move that leaves it, and make that move.

        Args:
            scores: Gives SA's score for each of MOVES in the current state; called only when SA is asked.
            reward: R of the transition into this state; counts when the state is captured now.
            finished: Eval() of what the agent has captured; see `arrive`.
        """
        arrival = self.arrive(reward, finished)
        return self.leave(arrival, self.choose(arrival.legal, scores()).move if arrival.legal else LAND)

    def arrive(self, reward: float, finished: Callable[[], bool] | None = None) -> Arrival:
        """Account for the current state and leave its group when that is due; the first half of `decide`.

        Args:
            reward: As in `decide`.
            finished: Eval() of what the agent has captured; asked once whenever the agent leaves a group and has
                another one before it, and before SA is asked. True ends the flight in this state.
        """
        captured = self.wants_capture()
        if captured:
            self._account(reward)
        if self._target == self.cell:
            self._target = None
        legal, answer = 0, None
        if self._target is None:
            before = self.group
            self._leave_groups()
            over = self.group == self.layout.parts[self.agent][1]
            if not over and self.group != before and finished is not None:
                over = answer = finished()
            if not over:
                legal = self._legal_moves()
                self._target = None if legal else self._nearest_left(self.group)
        return Arrival(captured, legal, answer)

    def choose(self, legal: int, scores: Sequence[float]) -> Choice:
        """The legal move of the highest score, the first of equals; now and then a random one."""
        moves = [move for move in range(len(MOVES)) if legal >> move & 1]
        if self.exploration > 0 and self._uniform(_EXPLORE) < self.exploration:
            return Choice(moves[draw(self.seed, self.mission, self.agent, self.step, _PICK) % len(moves)], True)
        return Choice(max(moves, key=lambda move: (scores[move], -move)), False)

    def leave(self, arrival: Arrival, choice: int) -> Decision:
        """Make the move that leaves the current state; the second half of `decide`.

        Args:
            arrival: What `arrive` gave in this state.
            choice: One of the legal moves; does not count when none is legal.
        """
        move = choice if arrival.legal else LAND
        if self._target is not None:
            move = self._towards(self._target)
        decision = Decision(self.step, self.cell, arrival.captured, arrival.legal, move)
        self.landed = move == LAND
        if not self.landed:
            self._move(move)
        return decision

    def land(self) -> None:
        """End the flight in the current state, for a reason that is outside of the mission."""
        self.landed = True

    def _account(self, reward: float) -> None:
        group = int(self.layout.group_of[self.cell])
        self.captured.add(self.cell)
        self.visited[group] = self.visited.get(group, 0) + 1
        if self.step > 0:
            self.utility[group] = self.utility.get(group, 0.0) + reward

    def _leave_groups(self) -> None:
        last = self.layout.parts[self.agent][1]
        while self.group < last and self._is_done(self.group):
            self.group += 1

    def _is_done(self, group: int) -> bool:
        history = self.history(group)
        return history.is_whole or self.ha.moves_on(history.utility, history.visited)

    def _legal_moves(self) -> int:
        """Moves within the group to states that are not captured, as bits."""
        legal = 0
        if self.layout.group_of[self.cell] == self.group:
            for move in self.layout.actions[self.agent]:
                cell = self.layout.grid.neighbour(self.cell, MOVES[move])
                if cell is not None and self.layout.group_of[cell] == self.group and cell not in self.captured:
                    legal |= 1 << move
        return legal

    def _uniform(self, purpose: int) -> float:
        return uniform(self.seed, self.mission, self.agent, self.step, purpose)

    def _nearest_left(self, group: int) -> int:
        """The nearest cell of a group that is not captured; the first of equals."""
        row, column = self.layout.grid.position(self.cell)

        def distance(cell: int) -> tuple[int, int]:
            other_row, other_column = self.layout.grid.position(cell)
            return abs(other_row - row) + abs(other_column - column), cell

        return min((int(cell) for cell in self.layout.groups[group] if int(cell) not in self.captured), key=distance)

    def _towards(self, target: int) -> int:
        """One cell along the longer way that is left; along the column of equals."""
        row, column = self.layout.grid.position(self.cell)
        target_row, target_column = self.layout.grid.position(target)
        rows, columns = target_row - row, target_column - column
        wanted = ((rows > 0) - (rows < 0), 0) if abs(rows) >= abs(columns) else (0, (columns > 0) - (columns < 0))
        steps = [self.layout.grid.step(action) for action in MOVES[:4]]
        return steps.index(wanted)

    def _move(self, move: int) -> None:
        cell = self.layout.grid.neighbour(self.cell, Action(MOVES[move]))
        assert cell is not None  # legal moves and moves towards a cell of the grid stay on the grid
        self.cell = cell
        self.step += 1

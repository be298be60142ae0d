"""A swarm that scouts one field with a common belief.

Every agent takes off in a part of the field of its own, and may then fly anywhere. It looks for the path along which
captures are most interesting for the energy they take (`interest`, `paths`), flies three moves of it, and looks again,
with all that every agent has captured by then; cells that others are about to capture are theirs. When no path nearby
is worth its energy, it goes where most is to be had. All agents land when the stop rule is met, so their flights are
equally long.

Knowledge passes between agents at once. Events happen in the order of mission time, of equal times in the order of
agents: a mission is the same however fast it is computed.
"""

from __future__ import annotations

import heapq
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from fleet.contexts.grid import Grid
from fleet.energy.accounting import EnergyModel
from fleet.errors import MissionError
from fleet.functions.belief import Belief
from fleet.missions.layout import MOVES
from fleet.missions.partition import parts
from fleet.planning.calibration import Calibration, expected_accuracy
from fleet.planning.interest import InterestWeights
from fleet.planning.outlook import Outlook
from fleet.planning.paths import PathFinder, Search
from fleet.planning.stop import StopRule
from fleet.spec.base import Model, NonNegative

Values = NDArray[np.float64]
Sense = Callable[[int], float]
"""From a cell with data to the quantity that is captured there; a finite number."""


class Tactics(Model):
    """How a swarm scouts."""

    weights: InterestWeights = Field(default=InterestWeights(), description="What makes a capture interesting.")
    search: Search = Field(default=Search(), description="How far and how wide is looked for paths.")
    moves: int = Field(default=3, description="Moves of a path that are flown before the next look.", ge=1)
    thrift: NonNegative = Field(
        default=0.7,
        description="What a path must bring for its energy, as a share of what the better half of the cells would.",
    )


@dataclass(eq=False)
class Scout:
    """One agent.

    Args:
        cell: Where it is.
        cells, captured: Its flight so far, and which visits captured the cell.
        plan: Moves that it will fly.
        fixed: How many of them are flown without another look.
        last: The last move; -1 for none.
    """

    cell: int
    cells: list[int] = field(default_factory=list)
    captured: list[bool] = field(default_factory=list)
    plan: deque[int] = field(default_factory=deque)
    fixed: int = 0
    last: int = -1


@dataclass(frozen=True)
class Claim:
    """What the swarm claimed at one moment.

    Args:
        time_s: Mission time.
        captured: Cells captured by all.
        predictions: How many predictions the claim was calibrated on.
        accuracy: Expected accuracy.
        energy_j: What all have spent, landings included.
    """

    time_s: float
    captured: int
    predictions: int
    accuracy: float
    energy_j: float


class Swarm:
    """A mission of a swarm.

    Args:
        grid: The field's cells.
        energy: What moves and captures cost.
        agents: How many fly.
        tactics: How.
        seed: Fixes where the agents take off.

    Raises:
        MissionError: there are fewer cells with data than agents.
    """

    def __init__(self, grid: Grid, energy: EnergyModel, agents: int, tactics: Tactics, seed: int) -> None:
        self._grid, self._energy, self._tactics = grid, energy, tactics
        self.finder = PathFinder(grid, energy, tactics.search)
        self.belief = Belief(grid)
        self.outlook = Outlook(self.belief, tactics.search.horizon)
        self.calibration = Calibration()
        self.claims: list[Claim] = []
        self._spent_j = agents * (energy.take_off() + energy.land()).energy_j
        generator = np.random.default_rng(seed)
        self.scouts = [Scout(int(generator.choice(part))) for part in parts(grid, agents)]
        self._claimed: list[deque[int] | None] = [None] * agents

    def fly(self, sense: Sense, rule: StopRule | None = None, watch: Callable[[], None] | None = None) -> None:
        """Fly until the stop rule is met, or until every cell is captured.

        Args:
            sense: The sensor.
            rule: When to stop; without one a claim is made all the same.
            watch: Called after each claim.
        Raises:
            MissionError: the sensor gave no finite number.
        """
        watch = watch or (lambda: None)
        events = [(self._energy.take_off().time_s, index) for index in range(len(self.scouts))]
        over = False
        while events and not over:
            time_s, index = heapq.heappop(events)
            scout = self.scouts[index]
            time_s += self._arrive(scout, sense)
            over = self._is_enough(time_s, rule, watch)
            if not over:
                move = self._energy.move(MOVES[self._next(scout)])
                time_s += move.time_s
                self._spent_j += move.energy_j
                heapq.heappush(events, (time_s, index))
        for _, index in sorted(events):  # those in the air finish their move, and land
            self._arrive(self.scouts[index], sense)

    def _arrive(self, scout: Scout, sense: Sense) -> float:
        """Capture the cell that was reached when it is a new one; the time that takes, in s."""
        fresh = bool(self.belief.free.flat[scout.cell])
        scout.cells.append(scout.cell)
        scout.captured.append(fresh)
        if not fresh:
            return 0.0
        value = sense(scout.cell)
        if not math.isfinite(value):
            raise MissionError(f"the sensor gave {value} in cell {scout.cell}; the quantity must be a finite number")
        self.calibration.foresee(self.belief, scout.cell, value)
        self.belief.observe([scout.cell], [value])
        capture = self._energy.capture()
        self._spent_j += capture.energy_j
        return capture.time_s

    def _is_enough(self, time_s: float, rule: StopRule | None, watch: Callable[[], None]) -> bool:
        """Make a claim now and then, and at the end, and ask the rule."""
        captured = self.belief.captured
        complete = captured == self.belief.cells
        if self.claims and not complete and captured < self.claims[-1].captured + self._tactics.moves:
            return False
        accuracy = expected_accuracy(self.belief, self.calibration)
        claim = Claim(time_s, captured, self.calibration.count, accuracy, self._spent_j)
        self.claims.append(claim)
        watch()
        return complete or (rule is not None and rule.is_met(claim.accuracy, claim.predictions))

    def _next(self, scout: Scout) -> int:
        """Choose the next move, and begin it."""
        if scout.fixed == 0 or not scout.plan:
            scout.plan = deque(self.choose_path(scout))
            scout.fixed = max(self._tactics.moves, self._moves_to_new(scout))
        move = scout.plan.popleft()
        scout.fixed -= 1
        scout.last = move
        scout.cell = self._after(scout.cell, move)
        return move

    def _moves_to_new(self, scout: Scout) -> int:
        """Moves of the plan up to its first cell that is not captured: an agent that looked again before it could fly
        to and fro for ever."""
        fresh = self.belief.free.flat[self._ahead(scout)[1:]]
        return int(np.argmax(fresh)) + 1 if fresh.any() else 0

    def choose_path(self, scout: Scout) -> tuple[int, ...]:
        """SA: the moves that an agent will fly from where it is, indices into MOVES; at least one.

        Args:
            scout: The agent, in a cell that is captured.
        """
        self._claim_for_all_but(scout)
        weights = self._tactics.weights
        view = self.outlook.view(scout.cell, weights)
        path = self.finder.best(view.interest, view.cell, scout.last, self._rate(view.typical))
        if path:
            return path
        target = self.outlook.richest(scout.cell, weights)
        return self._help(scout) if target is None else self.finder.towards(scout.cell, target)

    def _claim_for_all_but(self, scout: Scout) -> None:
        """What the others are about to capture is theirs. A plan that is the same object as before is the same one."""
        for index, other in enumerate(self.scouts):
            if other is scout:
                self.outlook.claim(index, ())
                self._claimed[index] = None
            elif self._claimed[index] is not other.plan:
                self.outlook.claim(index, self._ahead(other))
                self._claimed[index] = other.plan

    def _rate(self, typical: float) -> float:
        """Interest that a joule is worth: a share of what moves into the better half of the cells bring."""
        return self._tactics.thrift * typical / self.finder.mean_move_j

    def _help(self, scout: Scout) -> tuple[int, ...]:
        """The way to the nearest free cell, when others are about to capture all that is left."""
        left = np.argwhere(self.belief.free)
        way = np.abs(left - self._grid.position(scout.cell)).sum(axis=1)
        return self.finder.towards(scout.cell, self._grid.cell(*left[int(way.argmin())].tolist()))

    def _ahead(self, scout: Scout) -> list[int]:
        """The cells that an agent is about to visit."""
        cells = [scout.cell]
        for move in scout.plan:
            cells.append(self._after(cells[-1], move))
        return cells

    def _after(self, cell: int, move: int) -> int:
        down, across = self._grid.step(MOVES[move])
        return cell + down * self._grid.columns + across

"""What the agents of a mission know together, and how each of them decides where to fly and when to land.

Every agent may fly anywhere. It looks for the path along which captures are most interesting for the energy they take
(`interest`, `paths`), flies three moves of it, and looks again, with all that it has heard of the others by then; cells
that others are about to capture are theirs. When no path nearby is worth its energy, it goes where most is to be had.
At each look the agent first asks whether the map is good enough (`stop`), or another agent has found so: then it lands.

Whoever is told the same captures in the same order decides the same. So one such object flies a simulated swarm
(`swarm`), and in a real one each agent has its own, which it tells what it hears.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from fleet.energy.accounting import EnergyModel
from fleet.errors import MissionError
from fleet.functions.belief import Belief
from fleet.missions.layout import MOVES
from fleet.planning.calibration import Calibration, expected_accuracy
from fleet.planning.outlook import Outlook
from fleet.planning.paths import PathFinder
from fleet.planning.stop import Claim, StopRule
from fleet.planning.tactics import InterestWeights, Tactics

Values = NDArray[np.float64]


class Ending(StrEnum):
    """Why an agent lands: its own claim, another's, or because the others are about to reach all that is left."""

    GOAL_CLAIMED = "GoalClaimed"
    ANOTHER_LANDED = "AnotherLanded"
    ALL_CAPTURED = "AllCaptured"


@dataclass(eq=False)
class Scout:
    """One agent.

    Args:
        cell: Where it is.
        weights: What makes a capture interesting to it; that of the tactics when left out.
        plan: Moves that it will fly; another plan is another object.
        fixed: How many of them are flown without another look.
        last: The last move; -1 for none.
        landed: Whether it is down again.
        lost: Whether it should have reached its cell by now, and nobody has heard that it did: it claims nothing.
    """

    cell: int
    weights: InterestWeights | None = None
    plan: deque[int] = field(default_factory=deque)
    fixed: int = 0
    last: int = -1
    landed: bool = False
    lost: bool = False


class Scouting:
    """A mission as an agent sees it, or all of them when they hear of each other at once.

    Args:
        belief: What is believed of the field before the first capture.
        energy: What moves and captures cost.
        scouts: The agents where they take off.
        tactics: How they scout.
        rule: When to stop; without one claims are made all the same.
    """

    def __init__(
        self,
        belief: Belief,
        energy: EnergyModel,
        scouts: Sequence[Scout],
        tactics: Tactics,
        rule: StopRule | None = None,
    ) -> None:
        self.belief, self.grid, self.energy, self.tactics, self.rule = belief, belief.grid, energy, tactics, rule
        self.finder = PathFinder(self.grid, energy, tactics.search)
        self.outlook = Outlook(self.belief, tactics.search.horizon)
        self.calibration = Calibration()
        self.claims: list[Claim] = []
        self.scouts = list(scouts)
        self._claimed: list[deque[int] | None] = [None] * len(self.scouts)

    def take_in(self, cell: int, value: float) -> None:
        """What was found in a captured cell; nothing new in a cell that is known.

        Raises:
            MissionError: the value is not finite.
        """
        if not math.isfinite(value):
            raise MissionError(f"the sensor gave {value} in cell {cell}; the quantity must be a finite number")
        if self.belief.free.flat[cell]:
            self.calibration.foresee(self.belief, cell, value)
            self.belief.observe([cell], [value])

    def is_due(self, scout: Scout) -> bool:
        """Whether an agent looks again before its next move."""
        return scout.fixed == 0 or not scout.plan

    def look(self, scout: Scout, time_s: float) -> Ending | None:
        """Claim how good the map is, then land or choose what to fly next; the claim is the last of `claims`.

        Args:
            scout: An agent in a cell that was captured and taken in, if it has data.
            time_s: Mission time.
        """
        accuracy = expected_accuracy(self.belief, self.calibration)
        claim = Claim(time_s, self.belief.captured, self.calibration.count, accuracy)
        self.claims.append(claim)
        ending = self._ending(scout, claim)
        if ending is None:
            scout.plan = deque(self.choose_path(scout))
            scout.fixed = max(self.tactics.moves, self._moves_to_new(scout))
        else:
            scout.plan, scout.fixed, scout.landed = deque(), 0, True
        return ending

    def advance(self, scout: Scout) -> int:
        """Make the next move of an agent's plan; its index in MOVES."""
        move = scout.plan.popleft()
        scout.fixed -= 1
        scout.last = move
        scout.cell = self._after(scout.cell, move)
        return move

    def _ending(self, scout: Scout, claim: Claim) -> Ending | None:
        others = [other for other in self.scouts if other is not scout and not (other.landed or other.lost)]
        reached = {other.cell for other in others if self.belief.free.flat[other.cell]}
        if claim.captured + len(reached) == self.belief.cells:
            return Ending.ALL_CAPTURED
        if self.rule is not None and self.rule.is_met(claim.accuracy, claim.predictions):
            return Ending.GOAL_CLAIMED
        return Ending.ANOTHER_LANDED if any(other.landed for other in self.scouts) else None

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
        weights = scout.weights or self.tactics.weights
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
                self.outlook.claim(index, () if other.landed or other.lost else self._ahead(other))
                self._claimed[index] = other.plan

    def _rate(self, typical: float) -> float:
        """Interest that a joule is worth: a share of what moves into the better half of the cells bring."""
        return self.tactics.thrift * typical / self.finder.mean_move_j

    def _help(self, scout: Scout) -> tuple[int, ...]:
        """The way to the nearest free cell, when others are about to capture all that is left."""
        left = np.argwhere(self.belief.free)
        way = np.abs(left - self.grid.position(scout.cell)).sum(axis=1)
        return self.finder.towards(scout.cell, self.grid.cell(*left[int(way.argmin())].tolist()))

    def _ahead(self, scout: Scout) -> list[int]:
        """The cells that an agent is about to visit."""
        cells = [scout.cell]
        for move in scout.plan:
            cells.append(self._after(cells[-1], move))
        return cells

    def _after(self, cell: int, move: int) -> int:
        down, across = self.grid.step(MOVES[move])
        return cell + down * self.grid.columns + across

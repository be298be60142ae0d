"""How an agent decides that plans over the whole field: what it captured and heard, its models, and HA as a stop."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.clock import SystemClock
from fleet.contexts.base import Environment
from fleet.errors import MissionError, ModelError
from fleet.functions.belief import Belief
from fleet.learning.planner import blended, load_planners
from fleet.learning.reward import RewardModel
from fleet.missions.flight import LAND, Decision
from fleet.missions.layout import MOVES, layout_of
from fleet.missions.records import Record
from fleet.planning.paths import STRAIGHT
from fleet.planning.scouting import Ending, Scout, Scouting
from fleet.planning.stop import Claim, StopRule
from fleet.planning.tactics import Tactics
from fleet.runtime.hearing import Hearing, Told
from fleet.runtime.mind import Thought, check_relived, recorded_ssv
from fleet.runtime.settings import Settings


@dataclass(frozen=True, eq=False, kw_only=True)
class ScoutThought(Thought):
    """A decision of an agent that plans, and what it was made from.

    Args:
        ending: Why it lands; None when it flies on.
    """

    ending: Ending | None = None


class ScoutMind:
    """Decides for one agent; a `Mind`.

    Args:
        settings: Whose agent, which mission.
        environment: Where the mission flies.

    Raises:
        ModelError: a model cannot be loaded.
        MissionError: the mission has no weights for this agent, or the reward is none of a Planner.
    """

    def __init__(self, settings: Settings, environment: Environment) -> None:
        fleet, order = settings.fleet, settings.order
        self.reward = RewardModel.model_validate_json(settings.storage.read(settings.paths.reward))
        planner = self.reward.of_planner
        if planner.feature not in self.reward.features:
            raise ModelError(f"{planner.feature} is to be mapped, but Map() gives {', '.join(self.reward.features)}")
        self._column = self.reward.features.index(planner.feature)
        if settings.agent not in order.weights:
            raise MissionError(f"mission {order.number} has no model weights for {settings.agent}")
        self.weights = {key: weight for key, weight in order.weights[settings.agent].items() if weight > 0}
        self.models = load_planners(settings.storage, [each for each in order.models if each.key in self.weights])
        self.rule = StopRule(fleet.accuracy_goal or planner.goal, planner.caution)
        self.index = settings.agent_index
        self.agents = tuple(agent.name for agent in fleet.agents.resolved)
        scouts = [Scout(start) for start in layout_of(environment.grid, fleet).starts]
        tactics = Tactics(weights=blended(self.models, self.weights))
        self.scouting = Scouting(Belief.over(environment), settings.energy, scouts, tactics, self.rule)
        self.memory: dict[int, NDArray[np.float64]] = {}
        self._hearing = Hearing(settings, SystemClock())
        self._untold: list[tuple[float, int, float]] = []
        self._own: set[int] = set()
        self._step = 0

    @property
    def features(self) -> tuple[str, ...]:
        """Features of the SSV."""
        return self.reward.features

    @property
    def cell(self) -> int:
        """Where the agent is."""
        return self._scout.cell

    @property
    def landed(self) -> bool:
        """Whether the flight is over."""
        return self._scout.landed

    @property
    def groups(self) -> tuple[int, int]:
        """The field is one group for all, and explored when the agent has landed."""
        return 1, int(self.landed)

    def wants_capture(self) -> bool:
        """Whether the current state is to be sensed: it has data, and nobody captured it as far as the agent knows."""
        return bool(self.scouting.belief.free.flat[self.cell]) and self.cell not in self._own

    def visit(
        self, ssv: NDArray[np.float64] | None, time_s: float, finished: Callable[[], bool] | None = None
    ) -> ScoutThought:
        """Take in the current state's SSV, decide, and move on; see `Mind.visit`. Eval() is not asked in flight."""
        return self._visit(ssv, time_s, lambda: self._hearing.until(time_s))

    def relive(self, record: Record) -> ScoutThought:
        """Live a state of the log again, with what was heard then; see `Mind.relive`."""
        ssv = recorded_ssv(record, self.wants_capture(), self.reward.features)
        if self.scouting.is_due(self._scout) != bool(record.heard):
            raise MissionError(f"step {record.step} of the log was flown with another plan; start a new run")
        thought = self._visit(ssv, record.time_s, lambda: self._hearing.exactly(record.heard))
        check_relived(record, thought.decision)
        return thought

    @property
    def _scout(self) -> Scout:
        return self.scouting.scouts[self.index]

    def _visit(self, ssv: NDArray[np.float64] | None, time_s: float, hear: Callable[[], Told]) -> ScoutThought:
        scout, cell = self._scout, self.cell
        if ssv is not None:
            self.memory[cell] = ssv
            self._own.add(cell)
            self._untold.append((time_s, cell, float(ssv[self._column])))
        if not self.scouting.is_due(scout):
            return self._leave(cell, ssv is not None, 0)
        self._take_in(hear(), time_s)
        heard = self._counts()
        ending = self.scouting.look(scout, time_s)
        claim = self.scouting.claims[-1]
        if ending is None:
            return self._leave(cell, ssv is not None, self._open_moves(cell), claim, heard)
        decision = Decision(self._step, cell, ssv is not None, 0, LAND)
        return ScoutThought(decision=decision, heard=heard, claim=claim, ending=ending)

    def _leave(
        self, cell: int, captured: bool, legal: int, claim: Claim | None = None, heard: tuple[int, ...] = ()
    ) -> ScoutThought:
        move = self.scouting.advance(self._scout)
        decision = Decision(self._step, cell, captured, legal, move)
        self._step += 1
        return ScoutThought(decision=decision, plan=tuple(self._scout.plan), heard=heard, claim=claim)

    def _counts(self) -> tuple[int, ...]:
        """How many records of each agent are known; of the agent itself those before this state."""
        return tuple(self._step if index == self.index else count for index, count in enumerate(self._hearing.counts))

    def _take_in(self, told: Told, time_s: float) -> None:
        """Take in what was captured since the last look, in the order of mission time, and where the others are."""
        captures = [(time_s, self.index, cell, value) for time_s, cell, value in self._untold]
        for index, records in enumerate(told):
            captures += [
                (record.time_s, index, record.cell, record.ssv[self._column]) for record in records if record.captured
            ]
            if records:
                self._follow(self.scouting.scouts[index], records[-1])
        for index, other in enumerate(self.scouting.scouts):
            overdue = index != self.index and self._hearing.is_overdue(index, time_s)
            if overdue and not other.lost:
                other.plan = deque()
            other.lost = overdue
        self._untold = []
        for _, _, cell, value in sorted(captures):
            self.scouting.take_in(cell, value)

    def _follow(self, other: Scout, record: Record) -> None:
        """Where another agent goes, by its last record."""
        other.cell, other.landed = record.cell, record.move == LAND
        other.plan = deque()
        if not other.landed:
            other.plan = deque((record.move, *record.plan))
            self.scouting.advance(other)

    def _open_moves(self, cell: int) -> int:
        """Moves that SA could plan with, as bits."""
        grid = self.scouting.grid
        return sum(1 << move for move in range(STRAIGHT) if grid.neighbour(cell, MOVES[move]) is not None)

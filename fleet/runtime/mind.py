"""How one agent decides: its flight with its models, its memory and HA, and from what each decision was made.

The AS workflow flies with it; `fleet explain` lives a log again with it. So what is explained is what was decided.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Environment
from fleet.errors import MissionError
from fleet.learning.blend import blend
from fleet.learning.model import SAModel
from fleet.learning.models import load_model
from fleet.learning.reward import RewardModel
from fleet.missions.documents import ModelReference
from fleet.missions.flight import LAND, Arrival, Choice, Decision, Flight, GroupHistory
from fleet.missions.history import ThresholdHA
from fleet.missions.layout import MOVES, plan_layout
from fleet.missions.records import Record
from fleet.runtime.settings import Settings
from fleet.spec.functions import EvalChecks
from fleet.storage.port import Storage


@dataclass(frozen=True, eq=False)
class Thought:
    """One decision and what it was made from.

    Args:
        decision: What the agent does.
        arrival: What there was to choose.
        passing_to: The cell that the agent was on its way to and has not reached; None when HA was asked.
        histories: The group that the agent explored, those that it left here, and the one that it explores now.
        scores: Of each model that has a weight, float64 [len(MOVES)]; empty when SA was not asked.
        blended: The same as one, by the weights.
        choice: What was chosen of the legal moves; None when SA was not asked.
        target: The cell that the agent travels to from here; None when it explores or lands.
    """

    decision: Decision
    arrival: Arrival
    passing_to: int | None
    histories: tuple[GroupHistory, ...]
    target: int | None
    scores: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    blended: tuple[float, ...] = ()
    choice: Choice | None = None


class Mind:
    """Decides for one agent, state by state.

    Args:
        settings: Whose agent, which mission.
        environment: Where the mission flies.

    Raises:
        ModelError: a model cannot be loaded.
        MissionError: the mission has no weights for this agent.
    """

    def __init__(self, settings: Settings, environment: Environment) -> None:
        fleet, order = settings.fleet, settings.order
        self.reward = RewardModel.model_validate_json(settings.storage.read(settings.paths.reward))
        if settings.agent not in order.weights:
            raise MissionError(f"mission {order.number} has no model weights for {settings.agent}")
        self.weights = {key: weight for key, weight in order.weights[settings.agent].items() if weight > 0}
        self._models = load_models(settings.storage, order.models, self.weights)
        self._checks = fleet.eval.checks is EvalChecks.AFTER_GROUP
        self.ha = ThresholdHA(self.reward.utility_threshold, self.reward.visited_threshold)
        self.flight = Flight(
            plan_layout(environment.grid, fleet.state_space, fleet.agents.resolved),
            settings.agent_index,
            self.ha,
            seed=order.seed,
            mission=order.number,
            exploration=fleet.sa.flight_exploration,
        )
        self.memory: dict[int, NDArray[np.float64]] = {}

    def visit(self, ssv: NDArray[np.float64] | None, finished: Callable[[], bool] | None = None) -> Thought:
        """Take in the current state's SSV (None when it is not captured), decide, and move on.

        Args:
            ssv: State-space vector, float64 [features].
            finished: Eval() of what was captured so far; asked as in `Flight.arrive`, when the FleetSpec wants it.
        """
        flight = self.flight
        cell, before = flight.cell, flight.group
        passing_to = flight.target if flight.target != cell else None
        reward = 0.0
        if ssv is not None:
            self.memory[cell] = ssv
            reward = float(self.reward.reward(ssv[None])[0])
        arrival = flight.arrive(reward, finished if self._checks else None)
        histories = tuple(flight.history(group) for group in range(before, min(flight.group + 1, self._end)))
        if not arrival.legal:
            target = flight.target
            return Thought(flight.leave(arrival, LAND), arrival, passing_to, histories, target)
        scores = {key: model.scores(self.memory[cell][None])[0] for key, model in self._models.items()}
        blended = tuple(blend(scores, self.weights).tolist())
        choice = flight.choose(arrival.legal, blended)
        decision = flight.leave(arrival, choice.move)
        return Thought(decision, arrival, passing_to, histories, None, scores, blended, choice)

    def relive(self, record: Record) -> Thought:
        """Live a state of the log again.

        Raises:
            MissionError: the log is of another flight than these settings give.
        """
        ssv = self._ssv_of(record)
        thought = self.visit(ssv, finished=lambda: record.move == LAND)
        action = action_of(thought.decision)
        if (thought.decision.cell, action) != (record.cell, record.action):
            raise MissionError(
                f"step {record.step} of the log says {record.action} in cell {record.cell}, but this FleetSpec, "
                f"seed and models give {action} in cell {thought.decision.cell}; start a new run"
            )
        return thought

    def _ssv_of(self, record: Record) -> NDArray[np.float64] | None:
        """What was captured, when that is what this flight captures here."""
        ssv = np.array(record.ssv, dtype=np.float64) if record.captured else None
        if record.captured != self.flight.wants_capture() or (
            ssv is not None and len(ssv) != len(self.reward.features)
        ):
            said = f"an SSV of {len(record.ssv)} features" if record.captured else "no SSV"
            wanted = len(self.reward.features) if self.flight.wants_capture() else "no"
            raise MissionError(
                f"step {record.step} of the log has {said}, but here the flight captures {wanted} features; "
                "the log is damaged, or of another run"
            )
        return ssv

    @property
    def _end(self) -> int:
        return self.flight.layout.parts[self.flight.agent][1]


def action_of(decision: Decision) -> str:
    """The name of a move, or "Land"."""
    return "Land" if decision.move == LAND else str(MOVES[decision.move])


def load_models(
    storage: Storage, references: Sequence[ModelReference], weights: Mapping[str, float]
) -> dict[str, SAModel]:
    """The models that have a weight.

    Raises:
        MissionError: a weight is given to a model that the order does not list.
    """
    paths = {reference.key: reference.path for reference in references}
    missing = sorted(set(weights) - set(paths))
    if missing:
        raise MissionError(f"weights are given to models that the mission does not list: {', '.join(missing)}")
    return {key: load_model(storage.read(paths[key])) for key in sorted(weights)}

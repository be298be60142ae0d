"""How an agent decides that flies through state groups: its flight with its models, its memory and HA."""

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
from fleet.missions.flight import LAND, Arrival, Choice, Flight, GroupHistory
from fleet.missions.history import ThresholdHA
from fleet.missions.layout import layout_of
from fleet.missions.records import Record
from fleet.runtime.mind import Thought, check_relived, recorded_ssv
from fleet.runtime.settings import Settings
from fleet.spec.functions import EvalChecks
from fleet.storage.port import Storage


@dataclass(frozen=True, eq=False, kw_only=True)
class GroupThought(Thought):
    """A decision in a state group and what it was made from.

    Args:
        arrival: What there was to choose.
        passing_to: The cell that the agent was on its way to and has not reached; None when HA was asked.
        histories: The group that the agent explored, those that it left here, and the one that it explores now.
        scores: Of each model that has a weight, float64 [len(MOVES)]; empty when SA was not asked.
        blended: The same as one, by the weights.
        choice: What was chosen of the legal moves; None when SA was not asked.
        target: The cell that the agent travels to from here; None when it explores or lands.
    """

    arrival: Arrival
    passing_to: int | None
    histories: tuple[GroupHistory, ...]
    target: int | None
    scores: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    blended: tuple[float, ...] = ()
    choice: Choice | None = None


class GroupMind:
    """Decides for one agent, state by state; a `Mind`.

    Args:
        settings: Whose agent, which mission.
        environment: Where the mission flies.

    Raises:
        ModelError: a model cannot be loaded.
        MissionError: the mission has no weights for this agent.
    """

    def __init__(self, settings: Settings, environment: Environment) -> None:
        fleet, order = settings.fleet, settings.order
        self.reward = RewardModel.model_validate_json(settings.storage.read(settings.paths.reward)).of_groups
        if settings.agent not in order.weights:
            raise MissionError(f"mission {order.number} has no model weights for {settings.agent}")
        self.weights = {key: weight for key, weight in order.weights[settings.agent].items() if weight > 0}
        self._models = load_models(settings.storage, order.models, self.weights)
        self._checks = fleet.eval.checks is EvalChecks.AFTER_GROUP
        self.ha = ThresholdHA(self.reward.utility_threshold, self.reward.visited_threshold)
        self.flight = Flight(
            layout_of(environment.grid, fleet),
            settings.agent_index,
            self.ha,
            seed=order.seed,
            mission=order.number,
            exploration=fleet.sa.flight_exploration,
        )
        self.memory: dict[int, NDArray[np.float64]] = {}

    @property
    def features(self) -> tuple[str, ...]:
        """Features of the SSV."""
        return self.reward.features

    @property
    def cell(self) -> int:
        """Where the agent is."""
        return self.flight.cell

    @property
    def landed(self) -> bool:
        """Whether the flight is over."""
        return self.flight.landed

    @property
    def groups(self) -> tuple[int, int]:
        """State groups that are the agent's, and those of them that are behind it."""
        first, last = self.flight.layout.parts[self.flight.agent]
        return last - first, self.flight.groups_explored

    def wants_capture(self) -> bool:
        """Whether the current state is to be sensed and mapped."""
        return self.flight.wants_capture()

    def visit(
        self, ssv: NDArray[np.float64] | None, time_s: float, finished: Callable[[], bool] | None = None
    ) -> GroupThought:
        """Take in the current state's SSV, decide, and move on; see `Mind.visit`."""
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
            return GroupThought(
                decision=flight.leave(arrival, LAND),
                arrival=arrival,
                passing_to=passing_to,
                histories=histories,
                target=target,
            )
        scores = {key: model.scores(self.memory[cell][None])[0] for key, model in self._models.items()}
        blended = tuple(blend(scores, self.weights).tolist())
        choice = flight.choose(arrival.legal, blended)
        decision = flight.leave(arrival, choice.move)
        return GroupThought(
            decision=decision,
            arrival=arrival,
            passing_to=passing_to,
            histories=histories,
            target=None,
            scores=scores,
            blended=blended,
            choice=choice,
        )

    def relive(self, record: Record) -> GroupThought:
        """Live a state of the log again; see `Mind.relive`."""
        ssv = recorded_ssv(record, self.flight.wants_capture(), self.reward.features)
        thought = self.visit(ssv, record.time_s, finished=lambda: record.move == LAND)
        check_relived(record, thought.decision)
        return thought

    @property
    def _end(self) -> int:
        return self.flight.layout.parts[self.flight.agent][1]


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

"""Finds, from everything flown so far, the weights over models that each agent flies the next mission with."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fleet.aggregation.latest import latest_models
from fleet.aggregation.subsets import subsets_for
from fleet.errors import MissionError
from fleet.learning.goals import Objective
from fleet.learning.model import SAModel
from fleet.learning.models import load_model
from fleet.learning.planner import load_planners
from fleet.learning.reward import RewardModel
from fleet.missions.accounting import part_cells
from fleet.missions.documents import MissionEvaluation, MissionOrder, ModelReference, WeightsDocument
from fleet.missions.layout import Layout, layout_of
from fleet.missions.records import Record
from fleet.randomness import named_seed
from fleet.runtime.evaluation import read_logs
from fleet.runtime.remembering import captured_values, found, stored_environment
from fleet.runtime.settings import Settings
from fleet.spec.learning import SAKind
from fleet.usefulness.belief import believed_ssv
from fleet.usefulness.history import History, Observation
from fleet.usefulness.loss import Effort, MissionLoss, effort, full_energy_j, thorough_costs
from fleet.usefulness.replay import Replayer
from fleet.usefulness.weights import Replay, propose_weights, usefulness

_log = logging.getLogger(__name__)


def weigh(settings: Settings) -> None:
    """Propose the weights of the mission after the settings' one; nothing happens when they are there.

    Raises:
        MissionError: the mission is not over.
    """
    storage, paths, following = settings.storage, settings.paths, settings.mission + 1
    if storage.exists(paths.weights(following)):
        return
    flown = [_Flown(settings, number) for number in range(1, following)]
    subsets = [subset.key for subset in subsets_for(settings.fleet)]
    models = latest_models(storage, paths, following, subsets)
    history = History(tuple(observation for mission in flown for observation in mission.observations()))
    weights = propose_weights(
        history,
        [model.key for model in models],
        [agent.name for agent in settings.fleet.agents.resolved],
        settings.fleet.online_learning,
        named_seed(settings.fleet.missions.seed, f"weigh/{following}"),
        flown[-1].replayer(models) if settings.fleet.online_learning.replays else None,
    )
    document = WeightsDocument(
        number=following,
        weights=weights,
        usefulness=usefulness(weights, [model.key for model in models], history.flown),
    )
    storage.write(paths.weights(following), document.model_dump_json(by_alias=True, indent=1).encode())
    _log.info("mission %d has its weights", following)


class _Flown:
    """A mission that is over, as the learner of weights sees it.

    Args:
        settings: Of the trainer.
        number: The mission.
    """

    def __init__(self, settings: Settings, number: int) -> None:
        storage, paths = settings.storage, settings.paths
        self._settings = settings
        self._order = MissionOrder.model_validate_json(storage.read(paths.plan(number)))
        if not storage.exists(paths.evaluation(number)):
            raise MissionError(f"mission {number} is not over; its weights tell nothing yet")
        self._evaluation = MissionEvaluation.model_validate_json(storage.read(paths.evaluation(number)))
        self._environment = stored_environment(settings.at_mission(number))
        self._layout = layout_of(self._environment.grid, settings.fleet)
        self._efforts = self._efforts_of(self._layout)
        self._loss = self._loss_of(self._layout)

    def observations(self) -> list[Observation]:
        """One for each agent."""
        return [
            Observation(self._order.number, agent, self._order.weights[agent], self._loss.of(spent))
            for agent, spent in self._efforts.items()
        ]

    def replayer(self, models: Sequence[ModelReference]) -> Replay | None:
        """Replays the mission with the next mission's models; None when it captured nothing."""
        settings, agents = self._settings, list(self._efforts)
        logs = read_logs(settings.at_mission(self._order.number), agents)
        if not any(record.captured for log in logs.values() for record in log):
            return None
        if self._plans:
            return self._planned_replayer(models, logs)
        return Replayer(
            layout=self._layout,
            agents=agents,
            ssv=believed_ssv(self._layout.grid, logs),
            flown=self._order.weights,
            before=_load(settings, self._order.models),
            after=_load(settings, models),
            reward=RewardModel.model_validate_json(settings.storage.read(settings.paths.reward)),
            energy=settings.energy,
            loss=self._loss,
            efforts=self._efforts,
        )

    @property
    def _plans(self) -> bool:
        return self._settings.fleet.sa.kind is SAKind.PLANNER

    def _planned_replayer(self, models: Sequence[ModelReference], logs: Mapping[str, Sequence[Record]]) -> Replay:
        from fleet.usefulness.planned_replay import PlannedReplayer  # noqa: PLC0415 - numba loads only where it is used

        settings, storage = self._settings, self._settings.storage
        reward = RewardModel.model_validate_json(storage.read(settings.paths.reward))
        captured = captured_values(logs, reward, self._environment.grid)
        map_ = found(self._environment, captured)
        return PlannedReplayer(
            layout=self._layout,
            environment=replace(self._environment, truth=None if map_ is None else map_.values),
            agents=list(self._efforts),
            captured=int(np.count_nonzero(np.isfinite(captured))),
            flown=self._order.weights,
            before=load_planners(storage, self._order.models),
            after=load_planners(storage, models),
            energy=settings.energy,
            loss=self._loss,
        )

    def _efforts_of(self, layout: Layout) -> dict[str, Effort]:
        if self._plans:  # a common map: each agent's part in it is that of all
            whole = self._whole(layout)
            return {agent.agent: whole for agent in self._evaluation.agents}
        return {
            agent.agent: effort(layout, index, agent.captures, agent.uav_energy_j, self._settings.energy)
            for index, agent in enumerate(self._evaluation.agents)
        }

    def _loss_of(self, layout: Layout) -> MissionLoss:
        fleet, energy = self._settings.fleet, self._settings.energy
        shaping = fleet.reward_shaping
        objective = Objective(fleet.goals, shaping.minimise, shaping.margin)
        reference = thorough_costs(layout, energy).get(shaping.minimise, 1.0)
        return MissionLoss(objective, self._evaluation.metrics, self._whole(layout), reference)

    def _whole(self, layout: Layout) -> Effort:
        """The effort of all agents together."""
        indices = range(layout.agents)
        full_j = sum(full_energy_j(layout, index, self._settings.energy) for index in indices)
        cells = sum(part_cells(layout, index) for index in indices)
        captures = sum(agent.captures for agent in self._evaluation.agents)
        return Effort(min(1.0, captures / cells), self._evaluation.system.uav_energy_j / full_j)


def _load(settings: Settings, references: Sequence[ModelReference]) -> Mapping[str, SAModel]:
    return {reference.key: load_model(settings.storage.read(reference.path)) for reference in references}

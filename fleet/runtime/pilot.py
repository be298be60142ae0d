"""The AS workflow's mind: an agent's flight with its models, its memory and its log."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Environment
from fleet.errors import MissionError
from fleet.functions.contract import AgentMetrics
from fleet.learning.blend import blend
from fleet.learning.model import SAModel
from fleet.learning.models import load_model
from fleet.learning.reward import RewardModel
from fleet.missions.accounting import agent_metrics
from fleet.missions.documents import ModelReference
from fleet.missions.flight import LAND, Decision, Flight
from fleet.missions.history import ThresholdHA
from fleet.missions.layout import MOVES, plan_layout
from fleet.missions.records import Record
from fleet.runtime.odometer import Odometer
from fleet.runtime.settings import Settings
from fleet.storage.port import Storage


class Pilot:
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
        self._agent = settings.agent
        self._energy = settings.energy
        self._reward = RewardModel.model_validate_json(settings.storage.read(settings.paths.reward))
        if settings.agent not in order.weights:
            raise MissionError(f"mission {order.number} has no model weights for {settings.agent}")
        self._weights = {key: weight for key, weight in order.weights[settings.agent].items() if weight > 0}
        self._models = load_models(settings.storage, order.models, self._weights)
        layout = plan_layout(environment.grid, fleet.state_space, fleet.agents.resolved)
        self.flight = Flight(
            layout,
            settings.agent_index,
            ThresholdHA(self._reward.utility_threshold, self._reward.visited_threshold),
            seed=order.seed,
            mission=order.number,
            exploration=fleet.sa.flight_exploration,
        )
        first, last = layout.parts[settings.agent_index]
        self._groups = last - first
        self.odometer = Odometer(settings.energy)
        self.memory: dict[int, NDArray[np.float64]] = {}

    def replay(self, records: Sequence[Record]) -> None:
        """Live the log again, after the process was started anew.

        Raises:
            MissionError: the log is of another flight than these settings give.
        """
        for record in records:
            ssv = np.array(record.ssv) if record.captured else None
            landed = record.move == LAND
            replayed = self.visit(ssv, finished=lambda landed=landed: landed)  # type: ignore[misc]  # lambda's default
            if (replayed.cell, replayed.action) != (record.cell, record.action):
                raise MissionError(
                    f"step {record.step} of the log says {record.action} in cell {record.cell}, but this FleetSpec, "
                    f"seed and models give {replayed.action} in cell {replayed.cell}; start a new run"
                )

    @property
    def features(self) -> tuple[str, ...]:
        """Features of the SSV that the reward and the models expect."""
        return self._reward.features

    @property
    def metrics(self) -> AgentMetrics:
        """What the agent has done and spent so far, as if it landed here."""
        explored = self.flight.groups_explored
        return agent_metrics(self._agent, self.odometer.counts, self._energy, self._groups, explored)

    def visit(self, ssv: NDArray[np.float64] | None, finished: Callable[[], bool] | None = None) -> Record:
        """Take in the current state's SSV (None when it is not captured), and decide.

        Args:
            ssv: State-space vector, float64 [features].
            finished: Eval() of what was captured so far; see `Flight.arrive`.

        Returns:
            The record of this state; it must be durable before its action is carried out.
        """
        flight, odometer = self.flight, self.odometer
        cell = flight.cell
        odometer.arrive()
        arrived_s = odometer.time_s
        if ssv is not None:
            self.memory[cell] = ssv
            odometer.capture()
        energy_j = odometer.energy_j
        reward = float(self._reward.reward(ssv[None])[0]) if ssv is not None else 0.0
        decision = flight.decide(lambda: self._scores(cell), reward, finished)
        if decision.legal:
            odometer.decide()
        if decision.move != LAND:
            odometer.move(decision.move)
        return self._record(decision, ssv, arrived_s, energy_j)

    def _scores(self, cell: int) -> list[float]:
        rows = {key: model.scores(self.memory[cell][None]) for key, model in self._models.items()}
        scores: list[float] = blend(rows, self._weights)[0].tolist()
        return scores

    def _record(self, decision: Decision, ssv: NDArray[np.float64] | None, arrived_s: float, energy_j: float) -> Record:
        row, column = self.flight.layout.grid.position(decision.cell)
        return Record(
            step=decision.step,
            cell=decision.cell,
            row=row,
            column=column,
            captured=decision.captured,
            ssv=tuple(ssv.tolist()) if ssv is not None else (),
            legal=decision.legal,
            move=decision.move,
            action="Land" if decision.move == LAND else str(MOVES[decision.move]),
            time_s=arrived_s,
            uav_energy_j=energy_j,
        )


def load_models(
    storage: Storage, references: Sequence[ModelReference], weights: dict[str, float]
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

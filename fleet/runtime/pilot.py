"""The AS workflow's pilot: an agent's mind, what its flight costs, and the log of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Environment
from fleet.functions.contract import AgentMetrics
from fleet.missions.accounting import agent_metrics
from fleet.missions.flight import LAND
from fleet.missions.odometer import Odometer
from fleet.missions.records import Record
from fleet.runtime.mind import Thought, action_of, open_mind
from fleet.runtime.settings import Settings


class Pilot:
    """Decides for one agent, state by state, and accounts for it.

    Args:
        settings: Whose agent, which mission.
        environment: Where the mission flies.

    Raises:
        ModelError: a model cannot be loaded.
        MissionError: the mission has no weights for this agent.
    """

    def __init__(self, settings: Settings, environment: Environment) -> None:
        self._agent = settings.agent
        self._energy = settings.energy
        self._mind = open_mind(settings, environment)
        self._grid = environment.grid
        self.odometer = Odometer(settings.energy)

    def replay(self, records: Sequence[Record]) -> None:
        """Live the log again, after the process was started anew.

        Raises:
            MissionError: the log is of another flight than these settings give.
        """
        for record in records:
            self._account(record.captured, lambda _, record=record: self._mind.relive(record))  # type: ignore[misc]  # lambda's default

    @property
    def cell(self) -> int:
        """Where the agent is."""
        return self._mind.cell

    @property
    def landed(self) -> bool:
        """Whether the flight is over."""
        return self._mind.landed

    def wants_capture(self) -> bool:
        """Whether the current state is to be sensed and mapped."""
        return self._mind.wants_capture()

    @property
    def memory(self) -> dict[int, NDArray[np.float64]]:
        """SSVs that were captured, by cell."""
        return self._mind.memory

    @property
    def features(self) -> tuple[str, ...]:
        """Features of the SSV that the reward and the models expect."""
        return self._mind.features

    @property
    def metrics(self) -> AgentMetrics:
        """What the agent has done and spent so far, as if it landed here."""
        return agent_metrics(self._agent, self.odometer.counts, self._energy, *self._mind.groups)

    def visit(self, ssv: NDArray[np.float64] | None, finished: Callable[[], bool] | None = None) -> Record:
        """Take in the current state's SSV (None when it is not captured), and decide.

        Args:
            ssv: State-space vector, float64 [features].
            finished: Eval() of what was captured so far; see `Mind.visit`.

        Returns:
            The record of this state; it must be durable before its action is carried out.
        """
        arrived_s, energy_j, thought = self._account(
            ssv is not None, lambda time_s: self._mind.visit(ssv, time_s, finished)
        )
        decision = thought.decision
        row, column = self._grid.position(decision.cell)
        return Record(
            step=decision.step,
            cell=decision.cell,
            row=row,
            column=column,
            captured=decision.captured,
            ssv=tuple(ssv.tolist()) if ssv is not None else (),
            legal=decision.legal,
            move=decision.move,
            action=action_of(decision),
            time_s=arrived_s,
            uav_energy_j=energy_j,
            plan=thought.plan,
            heard=thought.heard,
            claimed=thought.claim.accuracy if thought.claim else None,
            predictions=thought.claim.predictions if thought.claim else 0,
        )

    def _account(self, captures: bool, think: Callable[[float], Thought]) -> tuple[float, float, Thought]:
        """Count a state; time on arrival in s, energy including the capture in J, and what was thought."""
        odometer = self.odometer
        odometer.arrive()
        arrived_s = odometer.time_s
        if captures:
            odometer.capture()
        energy_j = odometer.energy_j
        thought = think(arrived_s)
        if thought.decision.legal:
            odometer.decide()
        if thought.decision.move != LAND:
            odometer.move(thought.decision.move)
        return arrived_s, energy_j, thought

"""The AS workflow of one agent: sense, map, decide, record, act, until the agent has landed.

Every state's record is durable before its action is carried out. So the program may be killed at any moment: started
again, it lives its log again, says the last command once more, and goes on.
"""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from fleet.clock import Clock
from fleet.drivers.client import SensorClient
from fleet.drivers.port import Manoeuvre, OutOfStep
from fleet.errors import DriverError, FleetError, ObjectNotFound
from fleet.functions.clients import open_eval, open_map
from fleet.functions.contract import AgentMetrics, EvalClient, MapClient
from fleet.missions.accounting import agent_metrics
from fleet.missions.documents import Landing
from fleet.missions.records import Record, read_log
from fleet.runtime.evaluation import evaluate_if_last, feature_space_of
from fleet.runtime.pilot import Pilot
from fleet.runtime.settings import Settings
from fleet.spec.functions import EvalChecks

_log = logging.getLogger(__name__)
_OUT_OF_STEP_TRIES = 10


class Workflow:
    """Flies one agent's mission.

    Args:
        settings: Whose agent, which mission, where its sensor, Map() and Eval() are.
        clock: Waits between tries.
    """

    def __init__(self, settings: Settings, clock: Clock) -> None:
        self._settings = settings
        self._storage = settings.storage
        self._log_path = settings.paths.log(settings.mission, settings.agent)
        self._landing_path = settings.paths.landing(settings.mission, settings.agent)
        self._sensor = SensorClient(settings.sensor_url, clock)
        self._map: MapClient = open_map(settings.fleet.map, settings.map_url)
        self._eval: EvalClient = open_eval(settings.fleet.eval, settings.eval_url)
        self._records: list[Record] = []

    def run(self) -> None:
        """Fly to the end, or go on after a restart; then evaluate the mission if every other agent has landed.

        Raises:
            FleetError: the agent could not go on; if it never can, its failure is in storage before this is raised.
        """
        failure: FleetError | None = None
        if not self._storage.exists(self._landing_path):
            failure = self._fly_or_give_up()
        evaluate_if_last(self._settings, self._sensor.environment, self._eval)
        self._sensor.release()
        if failure is not None:
            raise failure

    def _fly_or_give_up(self) -> FleetError | None:
        try:
            metrics = self._fly()
        except FleetError as error:
            if error.exit_code != error.exit_code.PERMANENT:
                raise
            self._land(Landing(agent=self._settings.agent, failed=True, message=str(error), metrics=self._metrics()))
            return error
        self._land(Landing(agent=self._settings.agent, metrics=metrics))
        return None

    def _fly(self) -> AgentMetrics:
        environment = self._sensor.environment()
        self._environment = environment
        self._pilot: Pilot | None = None
        self._records = list(self._read_records())
        pilot = self._pilot = Pilot(self._settings, environment, self._map.features, self._is_finished)
        pilot.replay(self._records)
        while not pilot.flight.landed:
            record = pilot.visit(self._observe(pilot))
            self._storage.append(self._log_path, record.to_line())
            self._records.append(record)
        self._say_last_command()
        return self._metrics()

    def _read_records(self) -> tuple[Record, ...]:
        try:
            return read_log(self._storage.read(self._log_path))
        except ObjectNotFound:
            return ()

    def _observe(self, pilot: Pilot) -> NDArray[np.float64] | None:
        """Carry out the last decision, then sense and map the state that it led to, where that is wanted."""
        for _ in range(_OUT_OF_STEP_TRIES):
            try:
                self._say_last_command()
                if not pilot.flight.wants_capture():
                    return None
                observation = self._sensor.sense(executed=len(self._records) + 1)
                break
            except OutOfStep:  # the sensor role was started again: it is where the log says, one command behind
                _log.info("%s: the sensor was restarted; saying command %d again", self._settings.agent, len(self._records))
        else:
            raise DriverError("the sensor never got to where the log says that the vehicle is")
        return self._map.map(observation, self._settings.agent)

    def _say_last_command(self) -> None:
        command = self._records[-1].action if self._records else str(Manoeuvre.TAKE_OFF)
        self._sensor.act(len(self._records), command)

    def _is_finished(self) -> bool:
        """Ask Eval() about this agent's part; only where the FleetSpec wants that in flight."""
        if self._settings.fleet.eval.checks is not EvalChecks.AFTER_GROUP or self._pilot is None:
            return False
        fs = feature_space_of({self._settings.agent: self._pilot.memory}, self._map.features, self._environment)
        metrics = Metrics((self._metrics(),))
        return self._eval.evaluate(fs, metrics, self._settings.agent).finished

    def _metrics(self) -> AgentMetrics:
        pilot = getattr(self, "_pilot", None)
        if pilot is None:
            return AgentMetrics(self._settings.agent)
        return agent_metrics(
            self._settings.agent,
            pilot.odometer.counts,
            self._settings.energy,
            pilot.groups,
            pilot.flight.groups_explored,
        )

    def _land(self, landing: Landing) -> None:
        self._storage.write(self._landing_path, landing.model_dump_json(by_alias=True, indent=1).encode())
        _log.info("%s: %s", self._settings.agent, f"failed: {landing.message}" if landing.failed else "landed")

"""The AS workflow of one agent: sense, map, decide, record, act, until the agent has landed.

Every state's record is durable before its action is carried out. So the program may be killed at any moment: started
again, it lives its log again, says the last command once more, and goes on.
"""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from fleet.clock import Clock
from fleet.contexts.base import Environment, Observation
from fleet.drivers.client import SensorClient
from fleet.drivers.port import Manoeuvre, OutOfStep
from fleet.errors import DriverError, ExitCode, FleetError, ModelError, ObjectNotFound
from fleet.functions.clients import open_eval, open_map
from fleet.functions.contract import AgentMetrics, EvalClient, MapClient, Metrics
from fleet.missions.documents import Landing
from fleet.missions.records import Record, read_log
from fleet.runtime.evaluation import evaluate_if_last, feature_space_of
from fleet.runtime.pilot import Pilot
from fleet.runtime.remembering import kept_environment
from fleet.runtime.settings import Settings

_log = logging.getLogger(__name__)
_OUT_OF_STEP_TRIES = 10


def run_workflow(settings: Settings, clock: Clock) -> None:
    """Fly one agent's mission to its end, or go on after a restart; evaluate the mission when all have landed.

    Raises:
        FleetError: the agent could not go on. When it never can (`ExitCode.PERMANENT`), a landing that says why is in
            storage before this is raised, and the other agents fly on.
    """
    storage, landing_path = settings.storage, settings.paths.landing(settings.mission, settings.agent)
    sensor = SensorClient(settings.sensor_url, clock)
    evaluator = open_eval(settings.fleet.eval, settings.eval_url)
    failure: FleetError | None = None
    if not storage.exists(landing_path):
        landing, failure = _fly(settings, sensor, evaluator)
        storage.write(landing_path, landing.model_dump_json(by_alias=True, indent=1).encode())
        _log.info("%s has landed after %d states", settings.agent, landing.metrics.steps)
    evaluate_if_last(settings, evaluator)
    sensor.release()
    if failure is not None:
        raise failure


def _fly(settings: Settings, sensor: SensorClient, evaluator: EvalClient) -> tuple[Landing, FleetError | None]:
    """Fly; a failure that no restart can heal becomes a landing."""
    metrics = AgentMetrics(settings.agent)
    try:
        environment = kept_environment(settings, sensor.environment())
        pilot = Pilot(settings, environment)
        try:
            _Loop(settings, sensor, evaluator, environment, pilot).fly()
        finally:
            metrics = pilot.metrics
    except FleetError as error:
        if error.exit_code != ExitCode.PERMANENT:
            raise
        return Landing(agent=settings.agent, failed=True, message=str(error), metrics=metrics), error
    return Landing(agent=settings.agent, metrics=metrics), None


class _Loop:
    """The loop of one flight between a vehicle, Map(), a pilot and the log."""

    def __init__(
        self, settings: Settings, sensor: SensorClient, evaluator: EvalClient, environment: Environment, pilot: Pilot
    ) -> None:
        self._settings = settings
        self._sensor = sensor
        self._evaluator = evaluator
        self._environment = environment
        self._pilot = pilot
        self._map: MapClient = open_map(settings.fleet.map, settings.map_url)
        self._records: list[Record] = []

    def fly(self) -> None:
        path = self._settings.paths.log(self._settings.mission, self._settings.agent)
        self._records += _read_log(self._settings, path)
        self._pilot.replay(self._records)
        while not self._pilot.landed:
            record = self._pilot.visit(self._observe(), self._is_finished)
            self._settings.storage.append(path, record.to_line())
            self._records.append(record)
        self._land()

    def _observe(self) -> NDArray[np.float64] | None:
        """Carry out the last decision, then sense and map the state that it led to, where that is wanted."""
        observation = self._reach_and_sense()
        if observation is None:
            return None
        ssv = self._map.map(observation, self._settings.agent)
        if self._map.features != self._pilot.features:
            raise ModelError(
                f"the reward was shaped for the features {', '.join(self._pilot.features)}, but Map() gives "
                f"{', '.join(self._map.features)}; train again with this Map()"
            )
        return ssv

    def _reach_and_sense(self) -> Observation | None:
        for _ in range(_OUT_OF_STEP_TRIES):
            try:
                self._say_last_command()
                if not self._pilot.wants_capture():
                    return None
                return self._sensor.sense(executed=len(self._records) + 1)
            except OutOfStep:  # the sensor role was started again, and took its place from an older log
                self._catch_up()
        raise DriverError("the sensor does not get to where the log says that the vehicle is; see the sensor's log")

    def _land(self) -> None:
        try:
            self._say_last_command()
        except OutOfStep:
            self._catch_up()
            self._say_last_command()

    def _catch_up(self) -> None:
        """Say all commands again that the vehicle has not carried out."""
        executed = self._sensor.telemetry().executed
        _log.info("the sensor was started again; saying commands %d to %d again", executed, len(self._records))
        for number in range(executed, len(self._records)):
            self._sensor.act(number, self._command(number))

    def _say_last_command(self) -> None:
        number = len(self._records)
        self._sensor.act(number, self._command(number))

    def _command(self, number: int) -> str:
        return self._records[number - 1].action if number else str(Manoeuvre.TAKE_OFF)

    def _is_finished(self) -> bool:
        """Ask Eval() about this agent's part."""
        fs = feature_space_of({self._settings.agent: self._pilot.memory}, self._pilot.features, self._environment)
        return self._evaluator.evaluate(fs, Metrics((self._pilot.metrics,)), self._settings.agent).finished


def _read_log(settings: Settings, path: str) -> tuple[Record, ...]:
    try:
        return read_log(settings.storage.read(path))
    except ObjectNotFound:
        return ()

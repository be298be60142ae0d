"""The sensor of one agent: its action driver behind HTTP.

A simulated vehicle lives in this process. When the process is started again, the vehicle takes its place from the
agent's log; see `fleet.drivers.port`.
"""

from __future__ import annotations

import logging

from fleet.clock import Clock, ManualClock, SystemClock
from fleet.contexts.load import load_context
from fleet.drivers.port import Driver
from fleet.drivers.replay import ReplayDriver
from fleet.drivers.server import driver_app
from fleet.errors import ObjectNotFound
from fleet.functions.http_server import run_server
from fleet.missions.layout import layout_of
from fleet.missions.records import read_log
from fleet.runtime.settings import Settings
from fleet.spec.platform import ClockMode
from fleet.spec.swarm import DriverName

_log = logging.getLogger(__name__)


def run_sensor(settings: Settings) -> None:
    """Serve the vehicle of one agent until the mission releases it; ends at once when the agent has landed before.

    Raises:
        FleetError: the context, the plan or the log cannot be read, or the address cannot be bound.
    """
    if settings.storage.exists(settings.paths.landing(settings.mission, settings.agent)):
        _log.info("%s has landed before", settings.agent)
        return
    run_server(driver_app(_open_driver(settings)), settings.bind, settings.port)


def _open_driver(settings: Settings) -> Driver:
    agent = settings.fleet.agents.resolved[settings.agent_index]
    match agent.driver or DriverName.REPLAY:
        case DriverName.REPLAY:
            return _open_replay(settings)


def _open_replay(settings: Settings) -> ReplayDriver:
    fleet = settings.fleet
    context = load_context(settings.storage, settings.paths.context(settings.order.context))
    layout = layout_of(context.environment.grid, fleet)
    clock: Clock = SystemClock() if fleet.missions.clock is ClockMode.REAL else ManualClock()
    driver = ReplayDriver(context, layout.starts[settings.agent_index], settings.energy, clock)
    try:
        driver.restore(read_log(settings.storage.read(settings.paths.log(settings.mission, settings.agent))))
    except ObjectNotFound:
        _log.info("%s stands at its take-off cell", settings.agent)
    return driver

"""`python -m fleet.runtime ROLE`: one program a role; everything else comes from the environment."""

from __future__ import annotations

import logging
import os
import signal
import sys
from types import FrameType

from fleet.clock import SystemClock
from fleet.errors import ExitCode, FleetError
from fleet.runtime.settings import Settings

_log = logging.getLogger("fleet.runtime")


def _run(role: str, settings: Settings) -> None:
    """Import only what the role needs: four sensors should not hold four optimisers in memory."""
    match role:
        case "sensor":
            from fleet.runtime.sensor import run_sensor  # noqa: PLC0415

            run_sensor(settings)
        case "workflow":
            from fleet.runtime.workflow import run_workflow  # noqa: PLC0415

            run_workflow(settings, SystemClock())
        case "aggregator":
            from fleet.runtime.aggregator import aggregate  # noqa: PLC0415

            aggregate(settings)
        case "trainer":
            from fleet.runtime.trainer import run_trainer  # noqa: PLC0415

            run_trainer(settings)
        case _:
            raise SystemExit(f"{role!r} is not a role; write sensor, workflow, aggregator or trainer")


def main(arguments: list[str]) -> int:
    """Run a role; the exit code says whether starting it again may help (`ExitCode`)."""
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    logging.getLogger("httpx").setLevel(logging.WARNING)
    if len(arguments) != 1:
        sys.stderr.write("usage: python -m fleet.runtime sensor|workflow|aggregator|trainer\n")
        return ExitCode.USAGE
    try:
        _run(arguments[0], Settings.from_environment(os.environ))
    except FleetError as error:
        _log.error("%s", error)
        return error.exit_code
    return ExitCode.OK


def _end(number: int, _: FrameType | None) -> None:
    raise SystemExit(128 + number)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, _end)
    raise SystemExit(main(sys.argv[1:]))

"""A run that is broken off leaves no process, and the same command goes on where it was."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from fleet_operator.local.application import Application
from fleet_operator.local.ledger import RunState, read_document
from tests.fleet_runs import Recorder, application, fly, set_faults

ROOT = Path(__file__).parent.parent.parent
PATIENCE_S = 60.0
GRANDCHILD = "import time; time.sleep(600)  # grandchild of"
RUNNER = """
import sys
from pathlib import Path
from tests.fleet_runs import application, fly

try:
    fly(application(Path(sys.argv[1]), missions=1))
except KeyboardInterrupt:
    sys.exit(130)
"""
MACHINE = """
import os, sys
from pathlib import Path
from fleet_operator.local.addresses import Addresses
from fleet_operator.local.machine import Capacity, Machine
from tests.manifest_builders import classes, container, job, sidecar

folder = Path(sys.argv[1])
script = (
    "import os, pathlib, subprocess, sys, time\\n"
    f"command = [sys.executable, '-c', {sys.argv[2]!r}]\\n"
    "children = [subprocess.Popen(command) for _ in range(2)]\\n"
    f"pathlib.Path({str(folder / 'ready')!r}).touch()\\n"
    "time.sleep(600)"
)
machine = Machine(folder, Capacity(2, 2.0**33), print, Addresses(os.getpid()))
machine.apply([*classes(), job("flight", container("main", script), sidecar("map"))])
machine.run_while(lambda: True)
"""


def wait_until(reached: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not reached():
        assert time.monotonic() < deadline_s
        time.sleep(0.05)


def processes_of(text: str) -> list[int]:
    """Processes, other than this one, whose command or working folder has a text, zombies left out."""
    found = []
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit() or int(folder.name) == os.getpid():
            continue
        try:
            line = (folder / "cmdline").read_bytes().decode(errors="replace").replace("\0", " ")
            if text in line or text in str((folder / "cwd").readlink()):
                found.append(int(folder.name))
        except OSError:
            continue
    return found


@contextmanager
def python(script: str, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    path = os.pathsep.join([str(ROOT), str(ROOT / "operator")])
    environment = {**os.environ, "PYTHONPATH": path}
    process = subprocess.Popen([sys.executable, "-c", script, *arguments], env=environment, start_new_session=True)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def test_no_process_outlives_a_runner_that_is_killed(tmp_path: Path) -> None:
    grandchild = f"{GRANDCHILD} {tmp_path}"
    with python(MACHINE, str(tmp_path), grandchild) as runner:
        wait_until((tmp_path / "ready").exists)
        assert len(processes_of(str(tmp_path))) >= 5
        runner.kill()
        runner.wait()
        wait_until(lambda: not processes_of(str(tmp_path)))


def start_until_flying(fleet: Application) -> None:
    wait_until(lambda: fleet.storage.exists(fleet.paths.log(1, "agent-1")))
    wait_until(lambda: fleet.storage.exists(fleet.paths.log(1, "agent-2")))
    wait_until(lambda: all(begun(fleet, f"faults/workflow/agent-{agent}.json") for agent in (1, 2)))


def begun(fleet: Application, fault: str) -> bool:
    """Whether a fault is at work, or there is none: one that has not begun would happen to the next run."""
    path = f"{fleet.paths.root}/{fault}"
    return not fleet.storage.exists(path) or json.loads(fleet.storage.read(path)).get("times", 1) < 1


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_stops_everything_and_the_same_command_goes_on(
    tmp_path: Path, number: signal.Signals, code: int
) -> None:
    fleet = application(tmp_path, missions=1)
    set_faults(fleet, {f"workflow agent-{agent}": {"sleep": 600} for agent in (1, 2)})
    with python(RUNNER, str(tmp_path)) as runner:
        start_until_flying(fleet)
        os.kill(runner.pid, number)
        assert runner.wait(timeout=PATIENCE_S) == code
    assert not processes_of(str(fleet.out))
    document = read_document(fleet.out)
    assert document is not None
    assert document.state is RunState.INTERRUPTED
    display = Recorder()
    assert fly(fleet, display).missions[0].goals_met
    assert display.phases[:2] == ["copying contexts", "mission 1: flying with 2 agents"]
    resumed = read_document(fleet.out)
    assert resumed is not None
    assert (resumed.state, resumed.starts) == (RunState.FINISHED, 2)


def test_a_killed_run_goes_on_with_the_same_command(tmp_path: Path) -> None:
    fleet = application(tmp_path, missions=1)
    set_faults(fleet, {"workflow agent-1": {"sleep": 600}})
    with python(RUNNER, str(tmp_path)) as runner:
        start_until_flying(fleet)
        wait_until(lambda: fleet.storage.exists(fleet.paths.landing(1, "agent-2")))
        runner.kill()
        runner.wait()
        wait_until(lambda: not processes_of(str(fleet.out)))
    display = Recorder()
    assert fly(fleet, display).missions[0].failures == {}
    assert display.phases[:2] == ["copying contexts", "mission 1: flying with 1 agent"]

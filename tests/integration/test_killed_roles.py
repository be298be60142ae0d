"""Every role may be killed at any moment: the mission ends as if nothing had happened."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from fleet.errors import ObjectNotFound
from fleet.missions.records import Record, read_log
from fleet.storage.local import LocalStorage
from tests.scouting import PATHS, finish, processes_of, running, words

AGENTS = ("agent-1", "agent-2")
IN_FLIGHT = (("fleet.runtime", "sensor"), ("fleet.runtime", "workflow"), ("serve", "map"), ("serve", "eval"))
AFTERWARDS = (("fleet.runtime", "aggregator"), ("fleet.runtime", "trainer"))
PATIENCE_S = 60.0


@pytest.mark.parametrize("seed", range(20))
def test_a_mission_whose_roles_were_killed_ends_like_one_whose_were_not(
    seed: int, undisturbed: Path, tmp_path: Path
) -> None:
    _kill_and_compare(seed, undisturbed, tmp_path / "out")


@pytest.mark.parametrize("seed", range(4))
def test_so_does_a_mission_whose_agents_plan_together(seed: int, planned: Path, tmp_path: Path) -> None:
    """An agent that lives again must hear again what it heard, and the other one must wait for it."""
    _kill_and_compare(seed, planned, tmp_path / "out")


def _kill_and_compare(seed: int, undisturbed: Path, out: Path) -> None:
    shutil.copytree(undisturbed / "out", out)
    storage = LocalStorage(out / "storage")
    storage.delete(f"{PATHS.root}/missions")
    chance = random.Random(seed)
    with running(undisturbed / "swarm/fleetspec.yaml", out) as run:
        acknowledged = _kill_in_flight(out, storage, chance)
        for parts in AFTERWARDS:
            _kill_one(out, parts, chance, longest_s=0.8)
        assert finish(run, out) in {0, 1}, words(out)

    expected = LocalStorage(undisturbed / "out/storage")
    for agent in AGENTS:
        log = _log(storage, agent)
        assert log[: len(acknowledged[agent])] == acknowledged[agent]
        assert log == _log(expected, agent)
        assert _steps_written(storage, agent) == list(range(len(log)))
    same = [PATHS.evaluation(1), PATHS.weights(2), *(PATHS.model(1, key) for key in ("1", "2", "1-2"))]
    assert [storage.read(path) for path in same] == [expected.read(path) for path in same]


def _kill_in_flight(out: Path, storage: LocalStorage, chance: random.Random) -> dict[str, tuple[Record, ...]]:
    """Kill one process of each role at a random moment of the flight; what was acknowledged before the last kill."""
    _wait_for(lambda: any(_log(storage, agent) for agent in AGENTS))
    acknowledged: dict[str, tuple[Record, ...]] = dict.fromkeys(AGENTS, ())
    killed = 0
    for parts in chance.sample(IN_FLIGHT, len(IN_FLIGHT)):
        time.sleep(chance.uniform(0.0, 1.0))
        acknowledged = {agent: _log(storage, agent) for agent in AGENTS}
        killed += _kill(out, parts, chance)
    assert killed, "the mission was over before anything was killed"
    return acknowledged


def _kill_one(out: Path, parts: tuple[str, ...], chance: random.Random, longest_s: float) -> None:
    """Wait until a role runs, and kill it some time later; it may have ended by then."""
    _wait_for(lambda: bool(processes_of(out, *parts)))
    time.sleep(chance.uniform(0.0, longest_s))
    _kill(out, parts, chance)


def _kill(out: Path, parts: tuple[str, ...], chance: random.Random) -> bool:
    """Kill one of the processes of a role; False when there is none any more."""
    pids = processes_of(out, *parts)
    if not pids:
        return False
    try:
        os.kill(chance.choice(pids), signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True


def _wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "what the test waits for did not happen"
        time.sleep(0.02)


def _log(storage: LocalStorage, agent: str) -> tuple[Record, ...]:
    try:
        return read_log(storage.read(PATHS.log(1, agent)))
    except ObjectNotFound:
        return ()


def _steps_written(storage: LocalStorage, agent: str) -> list[int]:
    """Steps of all whole lines of a log, in the order of writing."""
    lines = storage.read(PATHS.log(1, agent)).splitlines()
    return [records[0].step for line in lines if (records := _alone(line))]


def _alone(line: bytes) -> tuple[Record, ...]:
    try:
        return (Record(**json.loads(line)),)
    except (ValueError, TypeError):
        return ()

"""Shaping and training that are killed at any moment go on, and end with the result of those that were not."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from tests.conftest import ROOT

RESULTS = ("reward.json", "model.npz", "shaping/trials.json", "training/candidates.json")


def start(folder: Path, workers: int, delay_s: float) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "tests.learning_process", str(folder), str(workers), str(delay_s)]
    return subprocess.Popen(command, cwd=ROOT, env=environment, start_new_session=True, stderr=subprocess.PIPE)


def results(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in RESULTS}


def steps(folder: Path) -> int:
    """How much the checkpoints hold."""
    total = 0
    for name, key in (("shaping/trials.json", "trials"), ("training/candidates.json", "scores")):
        if (folder / name).exists():
            total += len(json.loads((folder / name).read_bytes())["state"][key])
    return total


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("undisturbed")
    process = start(folder, workers=1, delay_s=0.0)
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors.decode()
    return results(folder)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "workers"), [(1, 1), (3, 2)])
def test_killed_again_and_again_it_ends_with_the_same_result(
    tmp_path: Path, undisturbed: dict[str, bytes], seed: int, workers: int
) -> None:
    moments = random.Random(seed)
    kills = 0
    while True:
        process = start(tmp_path, workers, delay_s=0.01)
        until = steps(tmp_path) + moments.randint(3, 14)
        while process.poll() is None and steps(tmp_path) < until:
            time.sleep(0.01)
        time.sleep(moments.uniform(0.0, 0.1))
        if process.poll() is not None:
            _, errors = process.communicate()
            assert process.returncode == 0, errors.decode()
            break
        os.kill(process.pid, signal.SIGKILL)
        process.communicate()
        kills += 1
    assert kills >= 1
    assert results(tmp_path) == undisturbed


def test_workers_end_when_their_parent_is_killed(tmp_path: Path) -> None:
    process = start(tmp_path, workers=2, delay_s=0.05)
    while process.poll() is None and steps(tmp_path) == 0:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    deadline = time.monotonic() + 60
    while _members(process.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert _members(process.pid) == []


def _members(group: int) -> list[int]:
    """Living processes of a process group."""
    found = []
    for process in psutil.process_iter():
        try:
            if os.getpgid(process.pid) == group and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process.pid)
        except (ProcessLookupError, psutil.NoSuchProcess):
            continue
    return found

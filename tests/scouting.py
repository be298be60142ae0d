"""A small swarm that is real in every part: the example's Map() and Eval() over a small field, in seconds."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fleet.contexts.cells import CubeContent
from fleet.contexts.files import write_cube
from fleet.storage.layout import FleetPaths
from fleet.storage.local import LocalStorage
from tests.conftest import ROOT
from tests.context_builders import cells, manifest

PATHS = FleetPaths("default", "scout")
_PROFILE = {
    "aircraft": {
        "quick": {
            "battery": {"capacity_mah": 1000, "voltage_v": 11.0},
            **{name: {"power_w": 100.0, "time_s": 0.03} for name in ("forward", "backward", "left", "right")},
            **{name: {"power_w": 50.0, "time_s": 0.1} for name in ("takeoff", "land", "capture", "hover")},
        }
    }
}


def field(seed: int, side: int = 9) -> CubeContent:
    """A square field whose excess green is a smooth hill with some noise, and a hole."""
    generator = np.random.default_rng(seed)
    positions = [(row, column) for row in range(side) for column in range(side) if (row, column) != (4, 4)]
    middle = generator.uniform(2, side - 2, size=2)
    hill = [60.0 * np.exp(-((row - middle[0]) ** 2 + (column - middle[1]) ** 2) / 12.0) for row, column in positions]
    values = {
        "exg": [10.0 + height + generator.normal(0, 1.5) for height in hill],
        "brightness": generator.uniform(0.5, 0.7, size=len(positions)).tolist(),
    }
    return CubeContent(manifest(("exg", "brightness"), rows=side, columns=side), cells(positions, values))


def write_swarm(folder: Path, **changes: Any) -> Path:
    """Write the swarm's folder; `changes` replace parts of the FleetSpec's spec. Gives the FleetSpec's file."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(ROOT / "examples/crop-scouting/crop_scouting.py", folder)
    (folder / "profiles.yaml").write_text(yaml.safe_dump(_PROFILE))
    for name, seed in (("first", 1), ("second", 2), ("third", 3)):
        write_cube(field(seed), LocalStorage(folder / name))
    spec: dict[str, Any] = {
        "agents": {"count": 2, "energyProfile": "profiles.yaml#quick"},
        "stateSpace": {"context": "third"},
        "map": {"function": "crop_scouting:map_observation"},
        "eval": {"function": "crop_scouting:evaluate"},
        "contexts": [
            {"name": "first", "uri": "first", "use": ["Shaping"]},
            {"name": "second", "uri": "second", "use": ["Training"]},
            {"name": "third", "uri": "third", "use": ["Mission"]},
        ],
        "goals": [{"metric": "accuracy", "atLeast": 0.5}],
        "ha": {"utilityThreshold": 100.0, "visitedThreshold": 5},
        "rewardShaping": {"epochs": 4, "missions": 8},
        "training": {"epochs": 1, "missions": 16},
        "missions": {"count": 1, "clock": "Real"},
        **changes,
    }
    document = {"apiVersion": "fleetcomputer.io/v1alpha1", "kind": "FleetSpec", "metadata": {"name": "scout"}}
    file = folder / "fleetspec.yaml"
    file.write_text(yaml.safe_dump({**document, "spec": spec}))
    return file


@contextmanager
def running(file: Path, out: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """`fleet run` as a user starts it, ended at the end of the block; its words are in `out`/words.txt."""
    out.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "fleet.cli", "run", str(file), "--out", str(out), *options]
    with (out / "words.txt").open("w") as said:
        run = subprocess.Popen(command, stdout=said, stderr=subprocess.STDOUT, text=True, start_new_session=True)
        try:
            yield run
        finally:
            if run.poll() is None:
                run.send_signal(signal.SIGINT)
                run.wait(20)


def finish(run: subprocess.Popen[str], out: Path, timeout_s: float = 240.0) -> int:
    """Wait for the end of a run. Gives its exit code; a run that hangs is ended and fails the test with its words."""
    try:
        return run.wait(timeout_s)
    except subprocess.TimeoutExpired:
        raise AssertionError(f"the run hung:\n{words(out)}") from None


def words(out: Path) -> str:
    """What a run said."""
    return (out / "words.txt").read_text()


def processes_of(out: Path, *parts: str) -> list[int]:
    """Process numbers of a run's roles whose command line has all of these parts, lowest first."""
    mark = f"HOME={(out / 'volumes').absolute()}/".encode()
    return sorted(pid for pid, command in _commands(mark) if all(part in command for part in parts))


def _commands(mark: bytes) -> Iterator[tuple[int, Sequence[str]]]:
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            if any(each.startswith(mark) for each in (folder / "environ").read_bytes().split(b"\0")):
                yield int(folder.name), (folder / "cmdline").read_text().split("\0")
        except OSError:  # it ended meanwhile
            continue

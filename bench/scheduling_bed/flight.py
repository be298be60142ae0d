"""One mission of the example, flown on this computer: what aggregators retrain from."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import yaml

from fleet.aggregation.subsets import subsets_for
from fleet.cli.inputs import read_spec
from fleet.spec.resources import FleetSpec
from fleet.storage.layout import FleetPaths
from fleet.storage.local import LocalStorage
from fleet_operator.flow.orders import write_order
from tests.testbed.installation import ROOT

Manifest = dict[str, Any]
FLOWN, PATROL = 1, 2
"""The mission that is retrained from, and the one that has sensors meanwhile."""
EXAMPLE = ROOT / "examples/crop-scouting"
EPOCHS = 1000


def fleet_spec(cores: float) -> Manifest:
    """The example with one mission over the whole field, little training, and no retraining of its own.

    Args:
        cores: Of a machine, which is what a sensor may use at most.
    """
    document: Manifest = yaml.safe_load((EXAMPLE / "in-state-groups.yaml").read_text())
    document["metadata"]["namespace"] = "default"
    document["spec"] |= {
        "missions": {"count": 1},
        "ha": {"utilityThreshold": 1e6, "visitedThreshold": 4096},  # never leaves a group before it has seen all of it
        "rewardShaping": {"epochs": 2, "batch": 2, "periods": 1, "missions": 16},
        "training": {"epochs": 1, "missions": 16},
        # As much work as a FleetSpec may ask for: the times of the API are whole seconds.
        "onlineLearning": {"retraining": {"epochs": EPOCHS, "every": 2}, "replays": 0},
        "workflow": {"sensorResources": {"limits": {"cpu": f"{round(cores * 1000)}m"}}},
    }
    return document


class Flight:
    """A mission that was flown.

    Args:
        folder: Where the application and its storage are put.
        cores: Of a machine of the cluster.

    Raises:
        RuntimeError: it could not be flown.
    """

    def __init__(self, folder: Path, cores: float) -> None:
        self.application = folder / "application"
        shutil.copytree(EXAMPLE, self.application)
        file = self.application / "fleetspec.yaml"
        file.write_text(yaml.safe_dump(fleet_spec(cores)))
        self.spec: FleetSpec = read_spec(file)
        self.folder = folder / "storage"
        self.subsets = tuple(subset.key for subset in subsets_for(self.spec.spec))
        self.agents = tuple(agent.name for agent in self.spec.spec.agents.resolved)
        self._storage = LocalStorage(self.folder)
        self._paths = FleetPaths("default", self.spec.name)
        self._fly(file, folder / "run")

    def forget_retraining(self) -> None:
        """Nothing was retrained: aggregators that find their result do nothing."""
        for folder in ("retraining", "models"):
            self._storage.delete(f"{self._paths.mission(FLOWN)}/{folder}")

    def _fly(self, file: Path, out: Path) -> None:
        command = [sys.executable, "-m", "fleet.cli", "run", str(file), "--out", str(out), "--quiet"]
        done = subprocess.run(
            [*command, "--storage", self._storage.uri], cwd=ROOT, check=False, capture_output=True, text=True
        )
        if done.returncode not in (0, 1):  # 1: the goals were not met
            raise RuntimeError(f"no mission to retrain from: {done.stderr.strip()[-2000:]}")
        write_order(self._storage, self._paths, self.spec.spec, PATROL, self.subsets)
        # Pods have another user than this process.
        for path in (self.folder, *self.folder.rglob("*")):
            path.chmod(0o777 if path.is_dir() else 0o666)

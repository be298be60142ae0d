"""A small, real swarm on a cluster, as its user sees it: by kubectl, and by what is in storage."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from fleet.missions.records import Record, read_log
from fleet.storage.hdfs import HdfsStorage
from fleet.storage.layout import FleetPaths
from tests.scouting import write_swarm
from tests.testbed.access import Access
from tests.testbed.waiting import T, wait_for

FLEET = "scout"
PATIENCE_S = 600.0
SERVERS_OWN = "configmap/kube-root-ca.crt"
KINDS = "missions,jobs,pods,services,endpointslices,networkpolicies,configmaps"
_STEP_S = 1.0


def write_spec(folder: Path, namespace: str, **missions: Any) -> Path:
    """The swarm's folder, with flights of half a minute where missions take real time; its FleetSpec's file."""
    file = write_swarm(
        folder,
        missions=missions,
        storage={"onDelete": "Retain"},
        rewardShaping={"epochs": 2, "missions": 4},
        training={"epochs": 1, "missions": 8},
    )
    profiles = yaml.safe_load((folder / "profiles.yaml").read_text())
    for move in ("forward", "backward", "left", "right"):
        profiles["aircraft"]["quick"][move]["time_s"] = _STEP_S
    (folder / "profiles.yaml").write_text(yaml.safe_dump(profiles))
    document = yaml.safe_load(file.read_text())
    document["metadata"]["namespace"] = namespace
    file.write_text(yaml.safe_dump(document))
    return file


@dataclass(frozen=True)
class Swarm:
    """The swarm in a namespace of its own.

    Args:
        storage: Its storage as this computer reaches it.
        folder: Of its files.
    """

    cluster: Access
    storage: HdfsStorage
    namespace: str
    folder: Path

    @property
    def paths(self) -> FleetPaths:
        return FleetPaths(self.namespace, FLEET)

    def apply(self, **missions: Any) -> None:
        """What a user types: the files beside the FleetSpec, then the FleetSpec."""
        file = write_spec(self.folder, self.namespace, **missions)
        command = [sys.executable, "-m", "fleet.cli", "files", str(file)]
        maps = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        self.cluster.kubectl("apply", "--server-side", "-f", "-", stdin=maps)
        self.cluster.kubectl("apply", "-f", str(file))

    def get(self, *args: str) -> Any:
        """`kubectl get` in the namespace."""
        return self.cluster.get(*args, "--namespace", self.namespace)

    def kubectl(self, *args: str) -> str:
        """kubectl in the namespace; waits as long as a busy computer may need."""
        return self.cluster.kubectl("--namespace", self.namespace, *args, timeout_s=PATIENCE_S + 60)

    def wait(self, condition: str) -> None:
        """`kubectl wait` for something of the FleetSpec."""
        try:
            self.kubectl("wait", f"fleetspec/{FLEET}", f"--for={condition}", f"--timeout={PATIENCE_S:.0f}s")
        except Exception as error:
            raise AssertionError(f"{condition}: {error}\n{self.tell()}") from error

    def wait_for(self, what: str, look: Callable[[], T | None]) -> T:
        """Wait for something else; the state of the fleet is told when it does not come."""
        try:
            return wait_for(what, look, PATIENCE_S, every_s=0.3)
        except Exception as error:
            raise AssertionError(f"{error}\n{self.tell()}") from error

    def tell(self) -> str:
        """Where the fleet is, for a failure."""
        about = self.cluster.kubectl("describe", "fleetspec", FLEET, "-n", self.namespace, check=False)
        objects = self.cluster.kubectl("get", "jobs,pods", "-o", "wide", "-n", self.namespace, check=False)
        return f"{about[-4000:]}\n{objects}"

    def reasons(self) -> list[str]:
        """Reasons of the events about the FleetSpec, the oldest first."""
        events = self.get("events", "--field-selector", f"involvedObject.kind=FleetSpec,involvedObject.name={FLEET}")
        return [each["reason"] for each in sorted(events["items"], key=lambda each: each["firstTimestamp"])]

    def last_told(self, reason: str) -> str:
        """When an event about the FleetSpec was last counted, ISO 8601; one that repeats keeps its first time too."""
        fields = f"involvedObject.kind=FleetSpec,involvedObject.name={FLEET},reason={reason}"
        return max(each["lastTimestamp"] for each in self.get("events", "--field-selector", fields)["items"])

    def objects(self) -> list[str]:
        """Everything that is in the namespace because of the FleetSpec."""
        found = self.kubectl("get", KINDS, "--output=name").split()
        # The user's own files stay: their ConfigMaps are no work of the operator.
        return sorted(
            name for name in found if name != SERVERS_OWN and not name.startswith(f"configmap/{FLEET}-files-")
        )

    def pod(self, job: str) -> dict[str, Any]:
        """The newest pod of a Job."""
        pods: list[dict[str, Any]] = self.get("pods", "--selector", f"batch.kubernetes.io/job-name={job}")["items"]
        return max(pods, key=lambda pod: str(pod["metadata"]["creationTimestamp"]))

    def run_in(self, pod: str, container: str, program: str) -> Any:
        """What a Python program prints as JSON in a container."""
        return json.loads(self.kubectl("exec", pod, "--container", container, "--", "python", "-c", program))

    def log(self, mission: int, agent: str) -> tuple[Record, ...]:
        """The acknowledged records of an agent, none before the first."""
        path = self.paths.log(mission, agent)
        return read_log(self.storage.read(path)) if self.storage.exists(path) else ()

    def content(self) -> dict[str, bytes]:
        """Everything of the fleet in storage, by its path below the fleet's folder."""
        root = self.paths.root
        return {entry.path.removeprefix(f"{root}/"): self.storage.read(entry.path) for entry in self.storage.list(root)}

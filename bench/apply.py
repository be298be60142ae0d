"""From `kubectl apply` to flying, beside the same pods made by hand.

    python -m bench.run apply
    python -m bench.apply --repeats 5

A test bed of a hub and three edge machines with the chart on it (needs root; see tests/testbed). The example fleet is
trained once, with small numbers. Then, in turn: its FleetSpec is applied and the operator does the rest; or the objects
that the operator had made (Services, Jobs, policies, functions) are applied at once by kubectl, with the order of the
mission in storage already. Both times end with the creation of the first log of an agent in HDFS, by the NameNode's
clock, which is this computer's.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import tempfile
import time
import urllib.request
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import yaml

from bench.measure import Result
from fleet.storage.hdfs import HdfsStorage
from fleet.storage.layout import FleetPaths
from tests.testbed.access import Access
from tests.testbed.bed import bed
from tests.testbed.images import PODS, image
from tests.testbed.installation import ROOT, install, reach_storage
from tests.testbed.waiting import wait_for

Manifest = dict[str, Any]
COMMAND = "python -m bench.apply"
EXAMPLE = ROOT / "examples/crop-scouting/fleetspec.yaml"
NAMESPACE, FLEET = "default", "crop-scouting"
KINDS = "services,jobs,networkpolicies,configmaps"
REPEATS = 5
_SELECTOR = f"fleetcomputer.io/fleet={FLEET}"
_OF_CLUSTER = ("uid", "resourceVersion", "creationTimestamp", "generation", "managedFields", "ownerReferences")
_OF_CONTROLLER = ("controller-uid", "job-name")
_LIMIT_S = 120.0


def fleet_spec(suspend: bool) -> Manifest:
    """The example with one mission, and with little training."""
    document: Manifest = yaml.safe_load(EXAMPLE.read_text())
    document["metadata"]["namespace"] = NAMESPACE
    document["spec"] |= {
        "suspend": suspend,
        "missions": {"count": 1},
        "rewardShaping": {"epochs": 2, "periods": 1, "missions": 16},
        "training": {"epochs": 1, "missions": 16},
    }
    return document


class Race:
    """Both ways to the same flight.

    Args:
        cluster: With the chart on it.
        storage: The chart's HDFS.
    """

    def __init__(self, cluster: Access, storage: HdfsStorage) -> None:
        self._cluster = cluster
        self._storage = storage
        self._paths = FleetPaths(NAMESPACE, FLEET)
        self._objects: list[Manifest] = []
        self._order: dict[str, bytes] = {}

    def train(self) -> None:
        """Everything that comes before the first mission."""
        self._cluster.apply(fleet_spec(suspend=True))
        phase = "{.status.phase}"
        self._cluster.kubectl(
            "wait", f"--for=jsonpath={phase}=Suspended", f"fleetspec/{FLEET}", "-n", NAMESPACE, "--timeout=900s",
            timeout_s=930.0,
        )  # fmt: skip

    def by_operator(self) -> float:
        """Seconds from the start of `kubectl apply -f fleetspec.yaml` to the first log."""
        self._clear()
        text = json.dumps(fleet_spec(suspend=False))
        began = time.time()
        self._cluster.kubectl("apply", "-f", "-", stdin=text)
        taken = self._first_log() - began
        if not self._objects:
            listed = self._cluster.get(KINDS, "-n", NAMESPACE, "-l", _SELECTOR)["items"]
            self._objects = [_as_applied(each) for each in listed if not _is_of_cluster(each)]
            paths = (self._paths.plan(1), self._paths.weights(1))
            self._order = {path: self._storage.read(path) for path in paths}
        return taken

    def by_hand(self) -> float:
        """Seconds from the start of `kubectl apply` of all objects to the first log."""
        self._clear()
        for path, data in self._order.items():
            self._storage.write(path, data)
        text = json.dumps({"apiVersion": "v1", "kind": "List", "items": self._objects})
        began = time.time()
        self._cluster.kubectl("apply", "--server-side", "-f", "-", stdin=text)
        return self._first_log() - began

    def _first_log(self) -> float:
        """When the first log of an agent was created, seconds since the Unix epoch."""
        agents = [f"agent-{number}" for number in range(1, 5)]

        def look() -> float | None:
            found = [at for agent in agents if (at := self._created_s(self._paths.log(1, agent))) is not None]
            return min(found, default=None)

        return wait_for("the first log of an agent", look, _LIMIT_S, 0.1)

    def _created_s(self, path: str) -> float | None:
        """When a file of HDFS was created: its time of access, which only a reader an hour later would change."""
        address = urlsplit(self._storage.uri)
        url = f"http://{address.hostname}:{address.port}/webhdfs/v1{address.path}/{path}?op=GETFILESTATUS"
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        try:
            with opener.open(f"{url}&user.name={address.username}", timeout=10) as answer:
                return float(json.load(answer)["FileStatus"]["accessTime"]) / 1000
        except OSError:
            return None

    def _clear(self) -> None:
        """No FleetSpec, no object, no mission; what was trained stays."""
        # What it has made goes with its FleetSpec; what was made by hand goes by its label.
        self._cluster.kubectl("delete", "fleetspec", FLEET, "-n", NAMESPACE, "--ignore-not-found", "--wait=true")
        self._cluster.kubectl("delete", KINDS, "-n", NAMESPACE, "-l", _SELECTOR, "--wait=true")
        left = ("get", f"{KINDS},pods,missions", "-n", NAMESPACE, "-l", _SELECTOR, "-o", "name")
        wait_for("all pods to be gone", lambda: not self._cluster.kubectl(*left).strip(), _LIMIT_S, 0.5)
        self._storage.delete(f"{self._paths.root}/missions")
        time.sleep(3.0)


def _is_of_cluster(body: Manifest) -> bool:
    """What neither the operator nor a user makes, and the training, which is over."""
    labels = body["metadata"].get("labels", {})
    return body["kind"] == "Job" and labels.get("fleetcomputer.io/role") not in ("Sensor", "Workflow")


def _as_applied(body: Manifest) -> Manifest:
    """An object as somebody would write it."""
    metadata = {key: value for key, value in body["metadata"].items() if key not in _OF_CLUSTER}
    metadata["annotations"] = {
        key: value for key, value in metadata.get("annotations", {}).items() if "batch.kubernetes.io" not in key
    }
    metadata["labels"] = _own(metadata.get("labels", {}))
    cleaned = {key: value for key, value in body.items() if key != "status"} | {"metadata": metadata}
    if body["kind"] == "Service":
        cleaned["spec"] = {key: value for key, value in body["spec"].items() if key not in ("clusterIPs",)}
    if body["kind"] == "Job":
        spec = {key: value for key, value in body["spec"].items() if key != "selector"}
        template = spec["template"]
        inner = {**template["metadata"], "labels": _own(template["metadata"].get("labels", {}))}
        inner.pop("creationTimestamp", None)
        cleaned["spec"] = spec | {"template": {**template, "metadata": inner}}
    return cleaned


def _own(labels: dict[str, str]) -> dict[str, str]:
    """Without the labels of the Job controller."""
    return {
        key: value
        for key, value in labels.items()
        if key not in _OF_CONTROLLER and not key.startswith("batch.kubernetes.io/")
    }


def run(repeats: int = REPEATS) -> list[Result]:
    before = os.getloadavg()[0]
    operator: list[float] = []
    hand: list[float] = []
    with (
        tempfile.TemporaryDirectory(prefix="fleet-bench-") as folder,
        bed(Path(folder), images=[image(name) for name in PODS]) as cluster,
    ):
        install(cluster, timeout="8m")
        race = Race(cluster, reach_storage(cluster))
        race.train()
        race.by_operator()  # the first flight of a machine is a warm-up: images are unpacked, programs read
        for _ in range(repeats):
            operator.append(race.by_operator())
            hand.append(race.by_hand())
            _say(f"operator {operator[-1]:.2f} s, by hand {hand[-1]:.2f} s, load {os.getloadavg()[0]:.1f}")
    made, known = statistics.median(operator), statistics.median(hand)
    more = statistics.median(one - other for one, other in zip(operator, hand, strict=True))
    name = f"median of {repeats}"
    return [
        Result.against(f"apply to first action, {name}", made, "s", ("the same pods by kubectl", known), COMMAND),
        Result(f"apply to first action, what the operator adds, {name} pairs", more, "s", command=COMMAND),
        Result("apply to first action, load average before", before, "", command=COMMAND),
        Result("apply to first action, load average after", os.getloadavg()[0], "", command=COMMAND),
    ]


def _say(text: str) -> None:
    print(f"  {time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=REPEATS)
    given = parser.parse_args(arguments)
    from rich.console import Console  # noqa: PLC0415 - only here

    from bench.run import table_of  # noqa: PLC0415 - it imports this module by name

    Console(width=None if sys.stdout.isatty() else 140).print(table_of(run(given.repeats)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

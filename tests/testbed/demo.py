"""`make demo-cluster`: the crop-scouting swarm on a real cluster, from nothing to the report of three missions.

Everything that a user would do by hand, in the same order: a cluster, `helm install`, `kubectl apply`, watching, and
`fleet report`. The cluster goes on running afterwards.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

from fleet.missions.documents import WeightsDocument
from fleet.storage.layout import FleetPaths
from fleet.storage.port import Storage
from fleet_operator.policy.level import priority_value
from tests.testbed import __main__ as commands
from tests.testbed.access import Access
from tests.testbed.errors import BedError
from tests.testbed.installation import ROOT, install, reach_storage
from tests.testbed.progress import say
from tests.testbed.waiting import wait_for

EXAMPLE = ROOT / "examples/crop-scouting/fleetspec.yaml"
NAMESPACE, FLEET = "default", "crop-scouting"
OUT = ROOT / "out/demo-cluster"
_EVERY_S = 0.5
_LIMIT_S = 1800.0


class Follower:
    """Says what becomes of a fleet: each event once, and the levels of its aggregators.

    Args:
        cluster: Where it flies.
        storage: Its storage, as this computer reaches it.
    """

    def __init__(self, cluster: Access, storage: Storage) -> None:
        self._cluster = cluster
        self._storage = storage
        self._paths = FleetPaths(NAMESPACE, FLEET)
        self._heard: set[tuple[str, str, str]] = set()
        self._shown: set[int] = set()
        self._started = time.monotonic()
        self.times: dict[str, float] = {}

    def follow(self) -> dict[str, Any]:
        """Follow the fleet until it has flown all missions, or can never.

        Returns:
            Its status.

        Raises:
            BedError: it has failed, or does not come to an end.
        """
        while time.monotonic() - self._started < _LIMIT_S:
            status: dict[str, Any] = self._cluster.get("fleetspec", FLEET, "-n", NAMESPACE).get("status", {})
            self._tell_events()
            self._tell_conditions(status)
            self._tell_levels(int(status.get("missionsFlown", 0)))
            if _condition(status, "Stalled") == "True" or status.get("phase") == "Failed":
                raise BedError(f"the fleet has failed; see: kubectl describe fleetspec {FLEET}")
            if status.get("phase") == "Done":
                return status
            time.sleep(_EVERY_S)
        raise BedError(f"the fleet did not end in {_LIMIT_S:.0f} s; see: kubectl describe fleetspec {FLEET}")

    def _tell_events(self) -> None:
        about = f"involvedObject.kind=FleetSpec,involvedObject.name={FLEET}"
        events = self._cluster.get("events", "-n", NAMESPACE, "--field-selector", about)["items"]
        for event in sorted(events, key=lambda each: each["lastTimestamp"]):
            key = (event["reason"], event["message"], event["involvedObject"]["uid"])
            if key not in self._heard:
                self._heard.add(key)
                self._say(f"{event['reason']:<16} {event['message']}")

    def _tell_conditions(self, status: dict[str, Any]) -> None:
        for condition in ("Trained", "Flying", "GoalsMet"):
            if condition not in self.times and _condition(status, condition) == "True":
                self.times[condition] = time.monotonic() - self._started

    def _tell_levels(self, flown: int) -> None:
        """Level and share of each aggregator that a mission was retrained with, once they are all there."""
        for number in range(1, flown + 1):
            if number in self._shown:
                continue
            jobs = self._cluster.get(
                "jobs", "-n", NAMESPACE, "-l", f"fleetcomputer.io/role=Aggregator,fleetcomputer.io/mission={number}"
            )["items"]
            if jobs:
                self._shown.add(number)
                weights = WeightsDocument.model_validate_json(self._storage.read(self._paths.weights(number)))
                for line in _table(jobs, weights.usefulness):
                    self._say(line)

    def _say(self, text: str) -> None:
        sys.stdout.write(f"{time.monotonic() - self._started:6.1f} s  {text}\n")
        sys.stdout.flush()


def _table(jobs: list[dict[str, Any]], usefulness: dict[str, float | None]) -> Iterator[str]:
    """One line for each level that aggregators have, the highest first."""
    by_level: dict[int, list[dict[str, Any]]] = {}
    for job in jobs:
        by_level.setdefault(int(job["metadata"]["labels"]["fleetcomputer.io/level"]), []).append(job)
    for level in sorted(by_level, reverse=True):
        members = by_level[level]
        subsets = [job["metadata"]["annotations"]["fleetcomputer.io/subset"] for job in members]
        limits = members[0]["spec"]["template"]["spec"]["containers"][0]["resources"]["limits"]
        run = "suspended" if level == 0 else f"cpu {limits['cpu']}, memory {limits['memory']}"
        shown = ", ".join(f"{subset} ({_number(usefulness.get(subset))})" for subset in sorted(subsets))
        yield f"  level {level}, priority {priority_value(level)}, {run}: subsets (usefulness) {shown}"


def _number(value: float | None) -> str:
    return "not flown yet" if value is None else f"{value:.2f}"


def _condition(status: dict[str, Any], kind: str) -> str:
    found = [each["status"] for each in status.get("conditions", ()) if each["type"] == kind]
    return found[0] if found else "Unknown"


def remove_earlier(cluster: Access, storage: Storage) -> None:
    """Delete what an earlier run of this demonstration left, its data too."""
    if not cluster.kubectl("get", "fleetspec", FLEET, "-n", NAMESPACE, "--ignore-not-found", "-o", "name"):
        return
    say("the fleet of an earlier run is deleted, with its data")
    patch = json.dumps({"spec": {"storage": {"onDelete": "Delete"}}})
    cluster.kubectl("patch", "fleetspec", FLEET, "-n", NAMESPACE, "--type", "merge", "-p", patch)
    root = FleetPaths(NAMESPACE, FLEET).root
    time.sleep(2.0)  # the operator notes what is to happen to the data
    cluster.kubectl("delete", "fleetspec", FLEET, "-n", NAMESPACE)
    wait_for("the earlier data to be deleted", lambda: not storage.list(root), 60.0)


def _timed(what: str, act: Callable[[], None], times: dict[str, float]) -> None:
    say(what)
    start = time.monotonic()
    act()
    times[what] = time.monotonic() - start


def demonstrate() -> None:
    """The whole demonstration."""
    times: dict[str, float] = {}
    options = commands.parser().parse_args(["up", "--images"])
    _timed("a cluster of one hub and three edge machines", lambda: commands.up(options), times)
    cluster = commands.needed()
    _timed("helm install: operator, HDFS, priorities", lambda: install(cluster), times)
    storage = reach_storage(cluster)
    remove_earlier(cluster, storage)
    follower = Follower(cluster, storage)
    say(f"kubectl apply -f {EXAMPLE.relative_to(ROOT)}")
    cluster.kubectl("apply", "-n", NAMESPACE, "-f", str(EXAMPLE))
    _timed("three missions", lambda: _fly(follower), times)
    say("\n" + cluster.kubectl("get", "fleets,missions", "-n", NAMESPACE).rstrip())
    OUT.mkdir(parents=True, exist_ok=True)
    place = ("--storage", storage.uri, "--fleet", f"{NAMESPACE}/{FLEET}")
    subprocess.run([sys.executable, "-m", "fleet.cli", "report", str(OUT), *place], check=True, cwd=ROOT)
    for what, seconds in {**times, **{f"apply to {key}": value for key, value in follower.times.items()}}.items():
        say(f"{seconds:6.1f} s  {what}")
    say(f"The cluster goes on: export KUBECONFIG={cluster.kubeconfig}; make cluster-down ends it.")


def _fly(follower: Follower) -> None:
    follower.follow()


def main() -> int:
    """Run the demonstration; the exit code."""
    try:
        demonstrate()
    except BedError as error:
        say(f"error: {error}")
        return 1
    except KeyboardInterrupt:
        say("interrupted; run it again, or end the cluster: make cluster-down")
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())

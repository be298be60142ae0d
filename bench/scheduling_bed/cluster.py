"""The small cluster: its machines, what is always there, and the runs."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from bench.scheduling_bed.flight import FLOWN, PATROL, Flight
from bench.scheduling_bed.lives import SUBSET, Life, Observed
from fleet_operator.compiler.defaults import SMALLEST_AGGREGATOR
from fleet_operator.compiler.fleet import function_sources, priority_classes
from fleet_operator.compiler.missions import compile_retraining, sensor_job
from fleet_operator.compiler.resizing import resizes
from fleet_operator.compiler.settings import Settings
from fleet_operator.compiler.target import AggregatorTerms, Target
from fleet_operator.flow.orders import Room, in_waves, terms_of_the_rest
from fleet_operator.flow.sources import read_bundle
from fleet_operator.resources.views import JobState, JobView, NodeView, PodView
from tests.testbed.bed import Bed, bed
from tests.testbed.errors import NotReady
from tests.testbed.images import image
from tests.testbed.site import GIB, BedSpec, Site, Size, machines
from tests.testbed.waiting import wait_for

Manifest = dict[str, Any]
SITE = Site("fb0", 127)
"""Not one of the tests' sites: both may run."""
GATEWAYS = 4
CORES = 0.1
NAMESPACE, CLAIM = "default", "storage"
SEEN = "/fleet/storage"
_AGGREGATOR, _SENSOR = "aggregator", "sensor"
_ROLE = "fleetcomputer.io/role"
_EVERY_S = 0.5
_LIMIT_S = 400.0
_PERIOD_US = 100_000


@dataclass(frozen=True)
class Run:
    """What became of the aggregators of one run.

    Args:
        lives: By subset.
        preempted: How often the scheduler ended an aggregator for another pod.
    """

    lives: dict[str, Life]
    preempted: int


class SmallCluster:
    """Machines with room for a sensor and one aggregator each.

    Args:
        target: The fleet, compiled for this cluster's storage.
    """

    def __init__(self, cluster: Bed, flight: Flight, target: Target) -> None:
        self._cluster = cluster
        self._flight = flight
        self.target = target
        self._sensors: set[str] = set()

    @cached_property
    def room(self) -> Room:
        """What the operator finds that aggregators may share."""
        return Room.of(NodeView.of(node) for node in self._cluster.get("nodes")["items"])

    def prepare(self) -> None:
        """Everything that is there in all runs: priorities, storage, functions, and sensors that are ready."""
        self._cluster.kubectl("cordon", self._cluster.machines[0].name)
        self._hold_to_size()
        self._cluster.apply(*priority_classes(), *_storage(self._flight.folder), *function_sources(self.target))
        self._cluster.apply(*(sensor_job(self.target, PATROL, agent) for agent in self._flight.agents))
        wait_for("the sensors", self._sensors_are_ready, _LIMIT_S, _EVERY_S)
        self._sensors = {pod["metadata"]["uid"] for pod in self._pods(_SENSOR)}

    def lost_sensors(self) -> int:
        """Sensors that were there at first and are not there any more, or that were started again."""
        well = {pod["metadata"]["uid"] for pod in self._pods(_SENSOR) if _runs_on(pod)}
        return len(self._sensors - well)

    def run(self, terms: Sequence[AggregatorTerms], target: Target | None = None) -> Run:
        """Make the Jobs of these aggregators at once, and wait until all that are not suspended have done their work.

        What runs gets new shares whenever others end, as the operator does it, where the terms have shares.

        Args:
            target: The fleet as these aggregators are compiled; that of the cluster when left out.
        Raises:
            NotReady: they have not ended within the time.
        """
        target = target or self.target
        seen, due = Observed(), {each.subset for each in terms if each.level}
        self._flight.forget_retraining()
        ordered = [each for wave in in_waves(terms) for each in wave]
        self._cluster.apply(*compile_retraining(target, FLOWN, ordered))
        end = time.monotonic() + _LIMIT_S
        while True:
            pods, jobs = self._pods(_AGGREGATOR), self._jobs()
            seen.add(pods)
            views = [JobView.of(job) for job in jobs]
            failed = [view.ref.name for view in views if view.state is JobState.FAILED]
            if failed or time.monotonic() > end:
                raise NotReady(f"aggregators are not done: failed {failed}\n{self._listing()}")
            over = {view.subset for view in views if view.state.over}
            if over >= due:
                break
            self._share(target, terms, over, pods, jobs)
            time.sleep(_EVERY_S)
        lives, preempted = seen.lives(jobs), self._preempted()
        self._clear()
        return Run({life.subset: life for life in lives}, preempted)

    def _share(
        self,
        target: Target,
        terms: Sequence[AggregatorTerms],
        over: set[str],
        pods: list[Manifest],
        jobs: list[Manifest],
    ) -> None:
        """What the operator's pass does while aggregators run."""
        if all(each.share is None for each in terms):
            return
        subsets = {job["metadata"]["name"]: job["metadata"]["annotations"][SUBSET] for job in jobs}
        views = {subsets[view.job]: view for pod in pods if not (view := PodView.of(pod)).deleting}
        running = {subset: view for subset, view in views.items() if view.phase == "Running"}
        has = {subset: view.containers[_AGGREGATOR] for subset, view in running.items()}
        queueing = {subset for subset, view in views.items() if view.finds_no_node}
        rest = terms_of_the_rest(target.fleet, terms, over | queueing, self.room)
        for subset, resources in resizes(target, rest, has).items():
            patch = {"spec": {"containers": [{"name": _AGGREGATOR, "resources": resources}]}}
            resize = ("patch", "pod", running[subset].ref.name, "-n", NAMESPACE, "--subresource", "resize")
            self._cluster.try_kubectl(*resize, "--patch", json.dumps(patch))  # it may have ended meanwhile

    def _hold_to_size(self) -> None:
        """Pods of a machine get the processor time that its node says it has, and no more: a bed shares all cores."""
        quota = round(CORES * _PERIOD_US)
        for machine in self._cluster.machines[1:]:
            machine.run("sh", "-c", f"echo {quota} > /sys/fs/cgroup/cpu/kubepods/cpu.cfs_quota_us")

    def _sensors_are_ready(self) -> bool:
        pods = self._pods(_SENSOR)
        return len(pods) == len(self._flight.agents) and all(_is_ready(pod) for pod in pods)

    def _pods(self, role: str) -> list[Manifest]:
        return self._items("pods", role)

    def _jobs(self) -> list[Manifest]:
        return self._items("jobs", _AGGREGATOR)

    def _items(self, kind: str, role: str) -> list[Manifest]:
        found: list[Manifest] = self._cluster.get(kind, "-n", NAMESPACE, "-l", f"{_ROLE}={role.capitalize()}")["items"]
        return found

    def _preempted(self) -> int:
        events = self._cluster.get("events", "-n", NAMESPACE, "--field-selector", "reason=Preempted")["items"]
        self._cluster.kubectl("delete", "events", "-n", NAMESPACE, "--field-selector", "reason=Preempted")
        return sum(_AGGREGATOR in event["involvedObject"]["name"] for event in events)

    def _clear(self) -> None:
        selector = f"{_ROLE}={_AGGREGATOR.capitalize()}"
        self._cluster.kubectl("delete", "jobs", "-n", NAMESPACE, "-l", selector, "--wait=true")
        wait_for("the aggregators to be gone", lambda: not self._pods(_AGGREGATOR), _LIMIT_S, _EVERY_S)

    def _listing(self) -> str:
        return self._cluster.kubectl("get", "jobs,pods", "-n", NAMESPACE, "-o", "wide", check=False)


@contextmanager
def small_cluster(folder: Path, flight: Flight) -> Iterator[SmallCluster]:
    """A hub that takes no pods, and gateways of a tenth of a core, with the sensors of a mission on them."""
    spec = BedSpec(SITE, machines(GATEWAYS, Size(CORES, GIB)))
    settings = Settings(storage_uri=f"file://{SEEN}", storage_claim=CLAIM, network_policies=False)
    target = Target(flight.spec, read_bundle(flight.spec.spec, flight.application), settings)
    with bed(folder, images=[image("runtime")], spec=spec, sites=(SITE,)) as cluster:
        small = SmallCluster(cluster, flight, target)
        small.prepare()
        yield small


def without_shares(target: Target) -> Target:
    """The fleet whose aggregators all get the same: the least request, and a machine as the limit."""
    amounts: Mapping[str, Mapping[str, str]] = {
        "requests": SMALLEST_AGGREGATOR.requests.model_dump(exclude_unset=True),
        "limits": {"cpu": f"{round(CORES * 1000)}m", "memory": "512Mi"},
    }
    document = target.spec.model_dump(by_alias=True, exclude_unset=True, mode="json")
    document["spec"]["aggregation"] = {"resources": amounts}
    return Target(type(target.spec).model_validate(document), target.bundle, target.settings)


def _storage(folder: Path) -> list[Manifest]:
    """A folder of this computer as a volume: every machine of the bed sees it under the same name."""
    common = {"storageClassName": "", "accessModes": ["ReadWriteMany"]}
    volume = {
        "apiVersion": "v1",
        "kind": "PersistentVolume",
        "metadata": {"name": CLAIM},
        "spec": {**common, "capacity": {"storage": "1Gi"}, "hostPath": {"path": str(folder), "type": "Directory"}},
    }
    claim = {
        "apiVersion": "v1",
        "kind": "PersistentVolumeClaim",
        "metadata": {"name": CLAIM, "namespace": NAMESPACE},
        "spec": {**common, "volumeName": CLAIM, "resources": {"requests": {"storage": "1Gi"}}},
    }
    return [volume, claim]


def _is_ready(pod: Manifest) -> bool:
    conditions = pod["status"].get("conditions", ())
    return any(one["type"] == "Ready" and one["status"] == "True" for one in conditions)


def _runs_on(pod: Manifest) -> bool:
    restarts = sum(int(one["restartCount"]) for one in pod["status"].get("containerStatuses", ()))
    return bool(pod["status"]["phase"] == "Running" and not restarts and "deletionTimestamp" not in pod["metadata"])

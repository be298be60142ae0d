"""A cluster in memory for tests of the reconciler: objects, Jobs that tests bring to their end, and counted calls.

Roles are functions that leave the documents of `tests.stand_in_roles`. Any call may be told to break off.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime

from fleet.clock import ManualClock
from fleet.functions.contract import AgentMetrics
from fleet.missions.documents import Landing
from fleet.missions.records import Record
from fleet.runtime.settings import Settings as RoleSettings
from fleet_operator.cluster.errors import NotFound
from fleet_operator.resources import names
from fleet_operator.resources.applied import applied_hash, mark_of, marked
from fleet_operator.resources.refs import (
    CONFIG_MAP,
    FLEET_SPEC,
    JOB,
    MISSION,
    Kind,
    Manifest,
    ObjectRef,
    kind_of,
)
from fleet_operator.resources.views import JobState, JobView, NodeView, PodView
from tests import stand_in_roles

Key = tuple[str, ObjectRef]


class Broken(BaseException):
    """The operator was killed at this call; nothing in the operator may catch it."""


@dataclass
class MemoryCluster:
    """Implements `fleet_operator.cluster.port.Cluster`.

    Args:
        clock: Gives creation times.

    Attributes:
        calls: Every call that changed or asked the API server, in order.
        before_call: Called before each of them; may raise.
        events: Reason of each event, by the name of what it is about.
        pod_views: What `pods` answers, by the name of the Job.
        warnings: What `complaints` answers, by the name of the object.
        resized: What was resized: pod and resources.
        made: How often an object was made or changed; uids come from it.
    """

    clock: ManualClock = field(default_factory=lambda: ManualClock(1_700_000_000.0))
    machines: tuple[NodeView, ...] = (
        NodeView("hub", "hub", ("hub", "10.0.0.1"), True, True, 4.0, 8 * 2**30),
        NodeView("edge1", "gateway", ("edge1", "10.0.0.2"), True, True, 2.0, 4 * 2**30),
    )
    before_call: Callable[[str], None] = lambda name: None
    objects: dict[Key, Manifest] = field(default_factory=dict)
    calls: list[str] = field(default_factory=list)
    events: list[tuple[str, str, str]] = field(default_factory=list)
    pod_views: dict[str, tuple[PodView, ...]] = field(default_factory=dict)
    warnings: dict[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)
    resized: list[tuple[str, Manifest]] = field(default_factory=list)
    made: int = 0

    def fleets(self) -> tuple[ObjectRef, ...]:
        return tuple(sorted(ref for kind, ref in self.objects if kind == FLEET_SPEC.kind))

    def fleet(self, ref: ObjectRef) -> Manifest | None:
        return self.objects.get((FLEET_SPEC.kind, ref))

    def jobs(self, ref: ObjectRef) -> tuple[JobView, ...]:
        views = [JobView.of(body) for body in self._of(JOB)]
        mine = [view for view in views if view.ref.namespace == ref.namespace and view.fleet == ref.name]
        return tuple(sorted(mine, key=lambda view: view.ref))

    def missions(self, ref: ObjectRef) -> Mapping[int, Manifest]:
        found = [body for body in self._of(MISSION) if body["spec"]["fleet"] == ref.name]
        return {body["spec"]["number"]: body for body in found if body["metadata"]["namespace"] == ref.namespace}

    def files(self, ref: ObjectRef) -> tuple[Manifest, ...]:
        found = [body for body in self._of(CONFIG_MAP) if body["metadata"]["labels"].get(names.FILES_LABEL) == ref.name]
        return tuple(sorted(found, key=lambda body: str(body["metadata"]["name"])))

    def nodes(self) -> tuple[NodeView, ...]:
        return self.machines

    async def apply(self, manifest: Manifest) -> bool:
        key = (kind_of(manifest).kind, ObjectRef.of(manifest))
        digest = applied_hash(manifest)
        there = self.objects.get(key)
        if there is not None and mark_of(there) == digest:
            return False
        self._call(f"apply {key[0]} {key[1].name}")
        self.put(marked(manifest, digest))
        return True

    async def apply_status(self, kind: Kind, ref: ObjectRef, status: Manifest) -> bool:
        there = self.objects.get((kind.kind, ref))
        if there is not None and there.get("status") == status:
            return False
        self._call(f"status {kind.kind} {ref.name}")
        if there is None:
            raise NotFound(f"{ref} is gone")
        there["status"] = copy.deepcopy(status)
        return True

    async def delete(self, kind: Kind, ref: ObjectRef, uid: str = "") -> None:
        self._call(f"delete {kind.kind} {ref.name}")
        there = self.objects.get((kind.kind, ref))
        if there is not None and uid in ("", there["metadata"]["uid"]):
            self.remove(kind, ref)

    async def pods(self, fleet: ObjectRef, job: str = "") -> tuple[PodView, ...]:
        self._call(f"pods {job}")
        return tuple(pod for name, pods in self.pod_views.items() for pod in pods if job in ("", name))

    async def complaints(self, ref: ObjectRef, kind: str) -> tuple[tuple[str, str], ...]:
        self._call(f"complaints {kind} {ref.name}")
        return self.warnings.get(ref.name, ())

    async def resize(self, pod: PodView, container: str, resources: Manifest) -> bool:
        self._call(f"resize {pod.ref.name}")
        self.resized.append((pod.ref.name, resources))
        return True

    async def record(self, about: Manifest, kind: str, reason: str, message: str) -> None:
        self._call(f"event {reason}")
        self.events.append((kind, reason, message))

    def put(self, manifest: Manifest) -> Manifest:
        """Make or replace an object, as its user or the API server would."""
        key = (kind_of(manifest).kind, ObjectRef.of(manifest))
        there = self.objects.get(key)
        self.made += 1
        body: Manifest = json.loads(json.dumps(manifest))
        if there is None:
            made = datetime.fromtimestamp(self.clock.now(), UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
            body["metadata"] |= {"uid": f"uid-{self.made}", "generation": 1, "creationTimestamp": made}
        else:
            generation = there["metadata"]["generation"] + (there.get("spec") != body.get("spec"))
            old = {name: there["metadata"][name] for name in ("uid", "creationTimestamp")}
            body["metadata"] |= {**old, "generation": generation}
            if "status" in there:
                body["status"] = there["status"]
        body["metadata"]["resourceVersion"] = str(self.made)
        self.objects[key] = body
        return body

    def remove(self, kind: Kind, ref: ObjectRef) -> None:
        """Delete an object and, as the garbage collector does, all that it owns."""
        gone = self.objects.pop((kind.kind, ref))["metadata"]["uid"]
        for (owned_kind, owned), body in list(self.objects.items()):
            if any(owner["uid"] == gone for owner in body["metadata"].get("ownerReferences", ())):
                self.objects.pop((owned_kind, owned), None)

    def run_jobs(self, faults: Mapping[str, str] | None = None) -> list[str]:
        """Let every Job that waits come to its end; the names of these Jobs.

        Args:
            faults: Message of each Job that fails, by the Job's name; "" ends without a result.
        """
        ended = []
        for body in list(self._of(JOB)):
            if JobView.of(body).state in (JobState.PENDING, JobState.RUNNING):
                self.end_job(body["metadata"]["name"], (faults or {}).get(body["metadata"]["name"]))
                ended.append(body["metadata"]["name"])
        return ended

    def end_job(self, name: str, fault: str | None = None) -> None:
        """Let one Job come to its end."""
        body = self.job(name)
        if fault is None:
            run_role(body)
        failed = bool(fault)
        condition = {"type": "Failed" if failed else "Complete", "status": "True", "message": fault or ""}
        body["status"] = {"conditions": [condition]}

    def start_job(self, name: str) -> None:
        """Let a Job's pod be ready."""
        self.job(name)["status"] = {"active": 1, "ready": 1}

    def job(self, name: str) -> Manifest:
        return next(body for body in self._of(JOB) if body["metadata"]["name"] == name)

    def _of(self, kind: Kind) -> list[Manifest]:
        return [self.objects[key] for key in sorted(self.objects) if key[0] == kind.kind]

    def _call(self, name: str) -> None:
        self.before_call(name)
        self.calls.append(name)


def run_role(job: Manifest) -> None:
    """Do at once what the program of a Job does."""
    container = job["spec"]["template"]["spec"]["containers"][0]
    settings = RoleSettings.from_environment({each["name"]: each["value"] for each in container["env"]})
    match container["name"]:
        case "workflow":
            _fly(settings)
        case "trainer":
            stand_in_roles.train(settings) if settings.task == "Train" else stand_in_roles.weigh(settings)
        case "aggregator":
            stand_in_roles.aggregate(settings)


def _fly(settings: RoleSettings) -> None:
    landing = settings.paths.landing(settings.mission, settings.agent)
    if not settings.storage.exists(landing):
        record = Record(0, 0, 0, 0, True, (1.0,), 0, -1, "Land", 10.0, 1000.0)
        settings.storage.append(settings.paths.log(settings.mission, settings.agent), record.to_line())
        metrics = AgentMetrics(settings.agent, 1, 1, 10.0, 1000.0, 10.0, 1, 1)
        stand_in_roles.write(settings, landing, Landing(agent=settings.agent, metrics=metrics))
    if not settings.storage.exists(settings.paths.evaluation(settings.mission)):
        stand_in_roles.evaluate(settings)

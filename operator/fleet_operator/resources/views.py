"""What the operator remembers of Jobs, Pods and Nodes: small, as there are tens of thousands of them at scale."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from sys import intern
from typing import Any

from fleet.spec.base import quantity_value
from fleet_operator.resources import names
from fleet_operator.resources.applied import mark_of
from fleet_operator.resources.refs import FLEET_SPEC, Manifest, ObjectRef
from fleet_operator.resources.roles import Role


class JobState(StrEnum):
    """How far a Job is."""

    SUSPENDED = "Suspended"
    PENDING = "Pending"
    """No pod is ready."""
    RUNNING = "Running"
    """A pod is ready."""
    SUCCEEDED = "Succeeded"
    FAILED = "Failed"

    @property
    def over(self) -> bool:
        """Nothing of it will run again."""
        return self in (JobState.SUCCEEDED, JobState.FAILED)


@dataclass(frozen=True, slots=True)
class JobView:
    """A Job of a fleet.

    Args:
        fleet: Name of the fleet; it is in the namespace of the Job.
        owner_uid: The FleetSpec object that it was made for; "" when none owns it.
        role: What it does; None when its label says nothing that is known.
        mission: Its mission; 0 is before the first.
        agent, subset: Whom it serves; "" when nobody.
        level: Scheduling level 0..10.
        applied: Hash of the manifest that it was made from.
        message: Why it failed; "" otherwise.
        created_s: Seconds since the Unix epoch.
        deleting: It was deleted, and is not gone yet.
        order: Hash of what its pods do; another one is worth making a Job anew that could not start.
        task: Tells its Jobs of one role and mission apart; "" when the role has one task only.
    """

    ref: ObjectRef
    uid: str
    fleet: str
    owner_uid: str
    role: Role | None
    mission: int
    agent: str
    subset: str
    level: int
    applied: str
    state: JobState
    message: str
    created_s: float
    deleting: bool
    order: str = ""
    task: str = ""

    @staticmethod
    def of(body: Mapping[str, Any]) -> JobView:
        """A view of a Job as the API gives it."""
        metadata = body["metadata"]
        labels, annotations = metadata.get("labels", {}), metadata.get("annotations", {})
        state, message = _job_state(body)
        return JobView(
            ref=_reference(metadata),
            uid=metadata.get("uid", ""),
            fleet=intern(labels.get(names.FLEET_LABEL, "")),
            owner_uid=intern(_owner_uid(metadata)),
            role=_role(labels.get(names.ROLE_LABEL, "")),
            mission=_number(labels.get(names.MISSION_LABEL, "")),
            agent=intern(annotations.get(names.AGENT_ANNOTATION, labels.get(names.AGENT_LABEL, ""))),
            subset=intern(annotations.get(names.SUBSET_ANNOTATION, labels.get(names.SUBSET_LABEL, ""))),
            level=_number(labels.get(names.LEVEL_LABEL, "")),
            applied=mark_of(body),
            state=state,
            message=message,
            created_s=seconds(metadata.get("creationTimestamp") or ""),
            deleting="deletionTimestamp" in metadata,
            order=intern(annotations.get(names.ORDER_ANNOTATION, "")),
            task=intern(labels.get(names.TASK_LABEL, "")),
        )


@dataclass(frozen=True, slots=True)
class PodView:
    """A Pod of a fleet.

    Args:
        job: Name of its Job.
        phase: As Kubernetes names it: Pending, Running, Succeeded, Failed, Unknown.
        node: Where it was placed; "" before.
        waiting: Why it cannot run: the reason of its first waiting container, or `Unschedulable`; "" when it can.
        message: What Kubernetes says of `waiting`, or of the end of the pod.
        restarts: Of all its containers together.
        containers: Resources of each container by name, as Kubernetes has them in `spec`.
        deleting: It was told to end, and its machine has not said yet that it has.
        started_s: When its machine took it on, before it got any image, in seconds since the Unix epoch; 0 before.
    """

    ref: ObjectRef
    job: str
    phase: str
    node: str
    waiting: str
    message: str
    restarts: int
    containers: Mapping[str, Manifest]
    deleting: bool = False
    started_s: float = 0.0

    @property
    def finds_no_node(self) -> bool:
        """Whether the scheduler has looked, and no node has room for it."""
        return not self.node and self.waiting == "Unschedulable"

    @staticmethod
    def of(body: Mapping[str, Any]) -> PodView:
        """A view of a Pod as the API gives it."""
        metadata, spec, status = body["metadata"], body.get("spec", {}), body.get("status", {})
        statuses = [*status.get("initContainerStatuses", ()), *status.get("containerStatuses", ())]
        waiting, message = _waiting(status, statuses)
        return PodView(
            ref=_reference(metadata),
            job=metadata.get("labels", {}).get("batch.kubernetes.io/job-name", ""),
            phase=status.get("phase", "Unknown"),
            node=spec.get("nodeName", ""),
            waiting=waiting,
            message=message,
            restarts=sum(each.get("restartCount", 0) for each in statuses),
            containers={
                each["name"]: each.get("resources", {})
                for each in (*spec.get("initContainers", ()), *spec.get("containers", ()))
            },
            deleting="deletionTimestamp" in metadata,
            started_s=seconds(status.get("startTime") or ""),
        )


@dataclass(frozen=True, slots=True)
class NodeView:
    """A machine of the cluster.

    Args:
        role: Label `fleetcomputer.io/role`: hub or gateway; "" when it has none.
        addresses: Its name and addresses, all that a storage may call it.
        cores, memory_bytes: Allocatable.
    """

    name: str
    role: str
    addresses: tuple[str, ...]
    ready: bool
    schedulable: bool
    cores: float
    memory_bytes: float

    @staticmethod
    def of(body: Mapping[str, Any]) -> NodeView:
        """A view of a Node as the API gives it."""
        metadata, spec, status = body["metadata"], body.get("spec", {}), body.get("status", {})
        amounts = status.get("allocatable", {})
        addresses = [metadata["name"], *(each["address"] for each in status.get("addresses", ()))]
        return NodeView(
            name=metadata["name"],
            role=intern(metadata.get("labels", {}).get(names.ROLE_LABEL, "")),
            addresses=tuple(dict.fromkeys(addresses)),
            ready=_condition(status, "Ready") is not None,
            schedulable=not spec.get("unschedulable", False),
            cores=_amount(amounts.get("cpu", "0")),
            memory_bytes=_amount(amounts.get("memory", "0")),
        )


def owner_of(body: Mapping[str, Any]) -> ObjectRef | None:
    """The FleetSpec that owns an object, or that its label names; None when it is nobody's."""
    metadata = body["metadata"]
    for owner in metadata.get("ownerReferences", ()):
        if owner.get("kind") == FLEET_SPEC.kind and owner.get("apiVersion") == FLEET_SPEC.api_version:
            return ObjectRef(metadata.get("namespace", ""), owner["name"])
    name = metadata.get("labels", {}).get(names.FLEET_LABEL, "")
    return ObjectRef(metadata.get("namespace", ""), name) if name else None


def seconds(stamp: str) -> float:
    """Seconds since the Unix epoch of a time as Kubernetes writes it; 0 for ""."""
    return datetime.fromisoformat(stamp).timestamp() if stamp else 0.0


def _reference(metadata: Mapping[str, Any]) -> ObjectRef:
    return ObjectRef(intern(metadata.get("namespace", "")), metadata["name"])


def _owner_uid(metadata: Mapping[str, Any]) -> str:
    owners = metadata.get("ownerReferences", ())
    return next((owner["uid"] for owner in owners if owner.get("kind") == FLEET_SPEC.kind), "")


def _job_state(body: Mapping[str, Any]) -> tuple[JobState, str]:
    status = body.get("status", {})
    failure = _condition(status, "Failed")
    if failure is not None:
        return JobState.FAILED, ": ".join(filter(None, (failure.get("reason", ""), failure.get("message", ""))))
    if _condition(status, "Complete") is not None:
        return JobState.SUCCEEDED, ""
    if body.get("spec", {}).get("suspend", False):
        return JobState.SUSPENDED, ""
    return (JobState.RUNNING if status.get("ready", 0) else JobState.PENDING), ""


def _condition(status: Mapping[str, Any], kind: str) -> Mapping[str, Any] | None:
    """A condition that is True."""
    conditions = status.get("conditions") or ()
    return next((each for each in conditions if each["type"] == kind and each["status"] == "True"), None)


def _waiting(status: Mapping[str, Any], statuses: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    for each in status.get("conditions") or ():
        if each["type"] == "PodScheduled" and each["status"] == "False":
            return each.get("reason", "Unschedulable"), each.get("message", "")
    for each in statuses:
        waiting = each.get("state", {}).get("waiting")
        if waiting and waiting.get("reason") not in _JUST_STARTING:
            return waiting.get("reason", ""), waiting.get("message", "")
    return "", status.get("message", "")


_ROLES = {role.value: role for role in Role}
_JUST_STARTING = ("PodInitializing", "ContainerCreating")


def _role(label: str) -> Role | None:
    return _ROLES.get(label)


def _number(label: str) -> int:
    return int(label) if label.isdecimal() else 0


def _amount(quantity: str) -> float:
    try:
        return quantity_value(quantity)
    except ValueError:  # suffixes that no machine of an edge site has: n, u, P, E
        return 0.0

"""Builder of Jobs: one pod that is tried again, but not when its input is at fault."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fleet_operator.compiler import defaults
from fleet_operator.compiler.placement import affinity, tolerations
from fleet_operator.compiler.target import Placement, Target
from fleet_operator.compiler.volumes import volumes
from fleet_operator.resources import names
from fleet_operator.resources.roles import LOWEST_LEVEL, REAL_TIME_LEVEL, Role

Manifest = dict[str, Any]


@dataclass(frozen=True)
class Identity:
    """Whose Job it is.

    Args:
        name: Name of the Job.
        role: What it does.
        level: Scheduling level 0..10; 0 is suspended.
        mission: Its mission; 0 is before the first.
        agent, subset: Whom it serves; "" when nobody.
        task: Tells Jobs of one role and mission apart; "" when its role has one task only.
        placement: Where its data is; None when that does not count.
    """

    name: str
    role: Role
    level: int
    mission: int = 0
    agent: str = ""
    subset: str = ""
    task: str = ""
    placement: Placement | None = None


def labels(target: Target, identity: Identity) -> dict[str, str]:
    """Labels of the objects of one Job."""
    own = {
        names.MISSION_LABEL: str(identity.mission) if identity.mission else "",
        names.ROLE_LABEL: identity.role.value,
        names.AGENT_LABEL: identity.agent,
        names.SUBSET_LABEL: identity.subset,
        names.LEVEL_LABEL: str(identity.level),
        names.TASK_LABEL: identity.task,
    }
    shown = {key: names.label_value(value) for key, value in own.items() if value}
    return {
        **fleet_labels(target.spec.name),
        "app.kubernetes.io/component": names.main_container(identity.role),
    } | shown


def fleet_labels(fleet: str) -> dict[str, str]:
    """Labels of every object of a fleet."""
    return {
        "app.kubernetes.io/name": names.PRODUCT,
        "app.kubernetes.io/instance": fleet,
        "app.kubernetes.io/part-of": names.PRODUCT,
        "app.kubernetes.io/managed-by": names.MANAGER,
        names.FLEET_LABEL: names.label_value(fleet),
    }


def fleet_metadata(target: Target, name: str) -> Manifest:
    """Metadata of an object of a fleet: its labels, and who owns it."""
    metadata: Manifest = {
        "name": name,
        "namespace": target.spec.metadata.namespace,
        "labels": fleet_labels(target.spec.name),
    }
    owner = target.owner
    if owner is not None:
        reference = {"apiVersion": owner.api_version, "kind": owner.kind, "name": owner.name, "uid": owner.uid}
        metadata["ownerReferences"] = [{**reference, "controller": True}]
    return metadata


def mission_metadata(target: Target, identity: Identity) -> Manifest:
    """Metadata of an object of one Job; annotations have the names that labels may have hashed."""
    metadata = fleet_metadata(target, identity.name)
    metadata["labels"] = labels(target, identity)
    told = {names.AGENT_ANNOTATION: identity.agent, names.SUBSET_ANNOTATION: identity.subset}
    annotations = {key: value for key, value in told.items() if value}
    return metadata | ({"annotations": annotations} if annotations else {})


def job(target: Target, identity: Identity, main: Manifest, sidecars: Sequence[Manifest] = ()) -> Manifest:
    """A Job of one pod; exit codes that say "the same input fails again" end it at once.

    podFailurePolicy needs restartPolicy Never (Kubernetes, "Pod failure policy"). A pod that was evicted or preempted
    does not count as a failure.
    """
    return {
        "apiVersion": "batch/v1",
        "kind": "Job",
        "metadata": mission_metadata(target, identity),
        "spec": {
            "suspend": identity.level == LOWEST_LEVEL,
            "backoffLimit": _retries(target, identity),
            "podFailurePolicy": {
                "rules": [
                    {
                        "action": "FailJob",
                        "onExitCodes": {
                            "containerName": main["name"],
                            "operator": "In",
                            "values": list(defaults.PERMANENT_EXIT_CODES),
                        },
                    },
                    {"action": "Ignore", "onPodConditions": [{"type": "DisruptionTarget", "status": "True"}]},
                ]
            },
            "template": {
                "metadata": {"labels": labels(target, identity)},
                "spec": _pod(target, identity, main, sidecars),
            },
        },
    }


def _retries(target: Target, identity: Identity) -> int:
    """Agents in flight are worth many tries; what only learns is not, for its input stays the same."""
    wanted = target.fleet.missions.agent_retries
    return wanted if identity.level == REAL_TIME_LEVEL else min(wanted, defaults.LEARNING_RETRIES)


def _grace_period_s(role: Role) -> int:
    return defaults.AGGREGATOR_GRACE_PERIOD_S if role is Role.AGGREGATOR else defaults.GRACE_PERIOD_S


def _pod(target: Target, identity: Identity, main: Manifest, sidecars: Sequence[Manifest]) -> Manifest:
    user = target.settings.user_id
    pod: Manifest = {
        "restartPolicy": "Never",
        "priorityClassName": names.priority_class(identity.level),
        "automountServiceAccountToken": False,
        "enableServiceLinks": False,
        "terminationGracePeriodSeconds": _grace_period_s(identity.role),
        "securityContext": {
            "runAsNonRoot": True,
            "runAsUser": user,
            "runAsGroup": user,
            "fsGroup": user,
            "fsGroupChangePolicy": "OnRootMismatch",
            "seccompProfile": {"type": "RuntimeDefault"},
        },
        "tolerations": tolerations(target),
    }
    wanted = affinity(identity.role, identity.placement)
    if wanted is not None:
        pod["affinity"] = wanted
    if sidecars:
        pod["initContainers"] = list(sidecars)
    pod["containers"] = [main]
    pod["volumes"] = volumes(target, [names.scratch_volume(each["name"]) for each in (main, *sidecars)])
    return pod

"""What a kubelet says of a pod: phase, conditions and the state of each container."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

Manifest = dict[str, Any]


@dataclass(frozen=True)
class View:
    """How far a pod is, without times: two equal views need one report.

    Args:
        phase: Pending, Running, Succeeded or Failed.
        running: Names of containers that have a process.
        started: Names of containers that have passed their startup probe.
        ready: The main container answers its readiness probe.
        restarts: By container.
        waiting: Why the containers do not start; "" when nothing hinders them.
        message: The same in words.
        code: Exit code of the main container, once it has ended.
    """

    phase: str = "Pending"
    running: frozenset[str] = frozenset()
    started: frozenset[str] = frozenset()
    ready: bool = False
    restarts: Mapping[str, int] = field(default_factory=dict)
    waiting: str = ""
    message: str = ""
    code: int | None = None

    @property
    def over(self) -> bool:
        return self.phase in {"Succeeded", "Failed"}


def status_of(pod: Manifest, view: View, address: str, started: str) -> Manifest:
    """`status` of a pod.

    Args:
        started: When the pod's first container was started.
    """
    spec = pod["spec"]
    containers = [_container(each, view, sidecar=False, started=started) for each in spec["containers"]]
    sidecars = [_container(each, view, sidecar=True, started=started) for each in spec.get("initContainers", ())]
    settled = view.phase == "Running" or view.over
    status: Manifest = {
        "phase": view.phase,
        "startTime": started,
        "hostIP": "127.0.0.1",
        "podIP": address or None,
        "podIPs": [{"ip": address}] if address else None,
        "conditions": [
            _condition("Initialized", settled),
            _condition("ContainersReady", view.ready),
            _condition("Ready", view.ready),
        ],
        "containerStatuses": containers,
    }
    if sidecars:
        status["initContainerStatuses"] = sidecars
    return status


def _condition(kind: str, holds: bool) -> Manifest:
    return {"type": kind, "status": "True" if holds else "False", "lastTransitionTime": now()}


def _container(container: Manifest, view: View, *, sidecar: bool, started: str) -> Manifest:
    name = container["name"]
    state = _state(name, view, sidecar, started)
    up = "running" in state and (sidecar or view.ready)
    return {
        "name": name,
        "image": container["image"],
        "imageID": "" if "waiting" in state else f"stand-in/{container['image']}",
        "containerID": "" if "waiting" in state else f"stand-in://{name}",
        "ready": up and name in view.started,
        "started": "running" in state and name in view.started,
        "restartCount": view.restarts.get(name, 0),
        "state": state,
    }


def _state(name: str, view: View, sidecar: bool, started: str) -> Manifest:
    if view.over:
        code = 0 if sidecar else view.code or 0
        reason = "Completed" if code == 0 else "Error"
        times = {"startedAt": started, "finishedAt": now()}
        return {"terminated": {"exitCode": code, "reason": reason, **times}}
    if name in view.running:
        return {"running": {"startedAt": started}}
    if view.waiting:
        return {"waiting": {"reason": view.waiting, "message": view.message}}
    if view.restarts.get(name):
        return {"waiting": {"reason": "CrashLoopBackOff", "message": view.message}}
    return {"waiting": {"reason": "ContainerCreating" if sidecar or not view.running else "PodInitializing"}}


def now() -> str:
    """The time as Kubernetes writes it."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")

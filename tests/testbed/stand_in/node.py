"""Nodes as the API server knows them: registered, Ready, with a lease that is renewed."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from tests.testbed.stand_in.api import AWAY, MERGE, Api, Refused
from tests.testbed.stand_in.statuses import now

LEASES = "/apis/coordination.k8s.io/v1/namespaces/kube-node-lease/leases"
NODES = "/api/v1/nodes"


@dataclass(frozen=True)
class Shape:
    """A node that is to be there.

    Args:
        role: hub or gateway.
        address: What storage calls its DataNode, too.
    """

    name: str
    role: str = "gateway"
    cpu: str = "32"
    memory: str = "64Gi"
    pods: int = 500
    address: str = "127.0.0.1"
    labels: Mapping[str, str] = field(default_factory=dict)


async def register(api: Api, shape: Shape) -> None:
    """Make the Node, or say that it is there again."""
    labels = {
        "kubernetes.io/hostname": shape.name,
        "kubernetes.io/os": "linux",
        "kubernetes.io/arch": "amd64",
        "fleetcomputer.io/role": shape.role,
        **shape.labels,
    }
    node = {"apiVersion": "v1", "kind": "Node", "metadata": {"name": shape.name, "labels": labels}}
    with contextlib.suppress(Refused):
        await api.call("POST", NODES, node)
    await _say_ready(api, shape)
    lease = {"metadata": {"name": shape.name, "namespace": "kube-node-lease"}, "spec": _lease(shape.name)}
    with contextlib.suppress(Refused):  # it is there already, or the namespace is not yet
        await api.call("POST", LEASES, {"apiVersion": "coordination.k8s.io/v1", "kind": "Lease", **lease})


async def renew(api: Api, shape: Shape) -> None:
    """Say that the node lives; a Node that somebody has deleted is registered anew, as a kubelet does at its start."""
    try:
        await api.call("PATCH", f"{LEASES}/{shape.name}", {"spec": _lease(shape.name)}, MERGE)
        await _say_ready(api, shape)
    except Refused as error:
        if error.status != 404:
            raise
        await register(api, shape)


async def _say_ready(api: Api, shape: Shape) -> None:
    amounts: dict[str, Any] = {"cpu": shape.cpu, "memory": shape.memory, "pods": str(shape.pods)}
    status = {
        "capacity": amounts,
        "allocatable": amounts,
        "addresses": [
            {"type": "InternalIP", "address": shape.address},
            {"type": "Hostname", "address": shape.name},
        ],
        "conditions": [
            {"type": "Ready", "status": "True", "reason": "KubeletReady", "message": "a stand-in",
             "lastHeartbeatTime": now()},
        ],
        "nodeInfo": {
            "architecture": "amd64", "operatingSystem": "linux", "kubeletVersion": "v1.37.2", "bootID": "",
            "containerRuntimeVersion": "", "kernelVersion": "", "kubeProxyVersion": "", "machineID": "",
            "osImage": "", "systemUUID": "",
        },
    }  # fmt: skip
    await api.call("PATCH", f"{NODES}/{shape.name}/status", {"status": status}, MERGE)


def _lease(holder: str) -> dict[str, Any]:
    time = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    return {"holderIdentity": holder, "leaseDurationSeconds": 8, "renewTime": time}


async def keep_alive(api: Api, shapes: Sequence[Shape], is_dark: Callable[[str], bool], every_s: float = 2.0) -> None:
    """Renew the leases of all nodes that are not dark, for ever."""
    while True:
        for shape in shapes:
            if not is_dark(shape.name):
                with contextlib.suppress(*AWAY):
                    await renew(api, shape)
        await asyncio.sleep(every_s)

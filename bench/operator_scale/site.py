"""The place of the benchmark: a control plane, KWOK's machines, the roles, and the operator, each a process."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from signal import SIGCONT, SIGSTOP

from bench.operator_scale.client import MERGE, Client
from bench.operator_scale.fleets import FLOOR, NAMESPACE, write_library
from bench.operator_scale.roles import HOLD
from fleet.storage.local import LocalStorage
from fleet_operator.compiler.fleet import priority_classes
from tests.testbed.binaries import tool
from tests.testbed.control_plane import ControlPlane, control_plane
from tests.testbed.ports import Ports
from tests.testbed.processes import Program

ROOT = Path(__file__).resolve().parents[2]
STAGES = Path(__file__).with_name("stages.yaml")
_AT_ONCE = 32
# Nodes say once in ten minutes that they live: leases of a thousand nodes are not what is measured. Nodes that are
# silent while everything but the operator is stopped are not lost.
_SILENCE = "600"
FLAGS = {
    "kube-controller-manager": [
        f"--node-monitor-grace-period={_SILENCE}s",
        "--concurrent-job-syncs=20",
        "--terminated-pod-gc-threshold=200000",
    ]
}

_ROOM = {"cpu": "8", "memory": "16Gi", "pods": "110"}
_STATUS = {"conditions": [{"type": "Ready", "status": "True"}], "allocatable": _ROOM, "capacity": _ROOM}


@dataclass(frozen=True)
class Site:
    """Everything but the operator.

    Args:
        folder: Of everything that is written; storage is in memory, so that no disk is measured.
        followers: What works on the objects that the operator makes: controllers, scheduler, KWOK.
    """

    plane: ControlPlane
    folder: Path
    storage: LocalStorage
    followers: tuple[Program, ...]
    ports: Ports

    @property
    def library(self) -> Path:
        return self.folder / "library"

    def operator(self) -> tuple[Program, int]:
        """An operator that is not started yet, and the port that it answers on."""
        port = self.ports.take()
        environment = {
            "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "operator")]),
            "KUBECONFIG": str(self.plane.kubeconfig),
            "FLEET_OPERATOR_NAMESPACE": "default",
            "FLEET_OPERATOR_WATCH_NAMESPACES": NAMESPACE,
            "FLEET_OPERATOR_STORAGE_URI": self.storage.uri,
            "FLEET_OPERATOR_LIBRARY": str(self.library),
            "FLEET_OPERATOR_HEALTH_PORT": str(port),
            "FLEET_OPERATOR_IDENTITY": "operator",
        }
        command = [sys.executable, *_profiled(self.folder), "-m", "fleet_operator"]
        return Program(command, self.folder / "operator.log", environment), port

    @contextmanager
    def stopped(self) -> Iterator[None]:
        """Nobody works on new objects: operator and floor have the API server for themselves."""
        hold = self.folder / HOLD
        hold.touch()
        for program in self.followers:
            program.signal(SIGSTOP)
        try:
            yield
        finally:
            hold.unlink()
            for program in self.followers:
                program.signal(SIGCONT)


def _profiled(folder: Path) -> list[str]:
    """FLEET_BENCH_PROFILE=1 writes where the time goes to operator.prof in the folder."""
    return ["-m", "cProfile", "-o", str(folder / "operator.prof")] if os.environ.get("FLEET_BENCH_PROFILE") else []


@asynccontextmanager
async def site(folder: Path, nodes: int, fleets: int, pods: bool) -> AsyncIterator[Site]:
    """Everything but the operator, as long as the context.

    Args:
        folder: In memory, best of all.
        pods: Whether there are controllers, a scheduler and KWOK, so that Jobs have pods. Without, the roles end Jobs.
    """
    write_library(folder / "library", fleets)
    ports = Ports()
    with control_plane(folder / "plane", controllers=pods, scheduler=pods, flags=FLAGS) as plane:
        for crd in sorted((ROOT / "crds").glob("*.yaml")):
            plane.kubectl("apply", "--server-side", "-f", str(crd))
        plane.apply(*priority_classes())
        plane.kubectl("wait", "--for=condition=Established", "crd", "--all")
        for name in (NAMESPACE, FLOOR):
            plane.kubectl("create", "namespace", name)
        followers = [*plane.controllers.values()]
        if pods:
            followers.append(_kwok(plane, folder, ports.take()))
            followers[-1].start()
        path = os.pathsep.join([str(ROOT), str(ROOT / "operator")])
        storage = LocalStorage(folder / "storage")
        command = [sys.executable, "-m", "bench.operator_scale.roles", str(plane.kubeconfig), str(storage.root)]
        roles = Program([*command, "pods" if pods else "jobs"], folder / "roles.log", {"PYTHONPATH": path})
        roles.start()
        try:
            await _make_nodes(plane, nodes, pods)
            yield Site(plane, folder, storage, tuple(followers), ports)
        finally:
            roles.kill()
            for program in followers[-1:] if pods else []:
                program.kill()
            ports.close()


def _kwok(plane: ControlPlane, folder: Path, port: int) -> Program:
    flags = [f"--config={STAGES}", f"--kubeconfig={plane.kubeconfig}", "--manage-all-nodes=true", "--cidr=10.99.0.0/16"]
    flags += [f"--node-lease-duration-seconds={_SILENCE}", f"--server-address=127.0.0.1:{port}"]
    return Program([tool("kwok"), *flags], folder / "kwok.log")


async def _make_nodes(plane: ControlPlane, nodes: int, pods: bool) -> None:
    limit = asyncio.Semaphore(_AT_ONCE)
    async with Client(plane.kubeconfig) as client:

        async def make(index: int) -> None:
            name = f"node-{index:04d}"
            labels = {"fleetcomputer.io/role": "hub" if index == 0 else "gateway", "kubernetes.io/hostname": name}
            body = {"apiVersion": "v1", "kind": "Node", "metadata": {"name": name, "labels": labels}}
            async with limit:
                await client.call("POST", "/api/v1/nodes", body)
                if not pods:  # then nobody says how it is
                    await client.call("PATCH", f"/api/v1/nodes/{name}/status", {"status": _STATUS}, MERGE)

        await asyncio.gather(*(make(index) for index in range(nodes)))
        while pods:
            listed = await client.call("GET", "/api/v1/nodes")
            able = [node for node in listed["items"] if not node["spec"].get("taints") and _is_ready(node["status"])]
            if len(able) == nodes:
                return
            await asyncio.sleep(0.5)


def _is_ready(status: dict[str, list[dict[str, str]]]) -> bool:
    return any(each["type"] == "Ready" and each["status"] == "True" for each in status.get("conditions", ()))

"""What all runs of the harness share: a control plane, an HDFS, stand-in kubelets, and slots with proxies."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import Queue

import yaml

from fleet_operator.compiler.fleet import priority_classes
from tests.crash.application import write_library
from tests.crash.cluster import Cluster
from tests.testbed.control_plane import ControlPlane, control_plane
from tests.testbed.hdfs import HdfsCluster, hdfs_cluster
from tests.testbed.proxy import Proxy
from tests.testbed.stand_in.node import Shape
from tests.testbed.stand_in.scheduler import KEPT_FOR
from tests.testbed.stand_in_kubelet import HUB_AND_EDGES, StandInKubelet, stand_in_kubelet

LOSES_A_NODE = "node-lost"
# A node that is lost is lost for one run only.
NODES = (*HUB_AND_EDGES, *(Shape(name, labels={KEPT_FOR: LOSES_A_NODE}) for name in ("edge3", "edge4")))
CRDS = Path(__file__).resolve().parent.parent.parent / "crds"
# Short, so that a lost node is told within the time of a test; a Job is synchronised as soon as something happens.
FLAGS = {
    "kube-apiserver": ["--default-not-ready-toleration-seconds=2", "--default-unreachable-toleration-seconds=2"],
    "kube-controller-manager": ["--node-monitor-grace-period=8s", "--node-monitor-period=1s"],
}


@dataclass(frozen=True)
class Slot:
    """The operator's two ways out, one of them for each run that goes on at the same time.

    Args:
        api: Leads to the API server.
        storage: Leads to the NameNode.
        kubeconfig: Leads through `api`.
    """

    api: Proxy
    storage: Proxy
    kubeconfig: Path

    @property
    def proxies(self) -> dict[str, Proxy]:
        return {"api": self.api, "storage": self.storage}


@dataclass(frozen=True)
class World:
    """Everything that runs go through.

    Args:
        library: Folder of the operator's image with the files of the fleet.
        slots: Those that no run uses now.
    """

    folder: Path
    plane: ControlPlane
    cluster: Cluster
    hdfs: HdfsCluster
    kubelet: StandInKubelet
    library: Path
    slots: Queue[Slot]

    @contextmanager
    def slot(self) -> Iterator[Slot]:
        """A slot for one run; waits for a free one."""
        slot = self.slots.get()
        try:
            yield slot
        finally:
            for proxy in slot.proxies.values():
                proxy.start_counting()
                proxy.faults.clear()
            self.slots.put(slot)

    def storage_uri(self, address: str, namespace: str) -> str:
        """Storage of one run: a folder of its own."""
        return f"webhdfs://fleet@{address}/fleet/{namespace}"


@contextmanager
def world(folder: Path, slots: int, datanodes: int = 3) -> Iterator[World]:
    """Start everything; half a minute of one core."""
    with ExitStack() as stack:
        plane = stack.enter_context(control_plane(folder / "control-plane", flags=FLAGS))
        hdfs = stack.enter_context(hdfs_cluster(folder / "hdfs", datanodes=datanodes))
        made = [_slot(stack, folder, plane, hdfs) for _ in range(slots)]
        direct = {f"127.0.0.1:{each.storage.port}": hdfs.address for each in made}
        kubelet = stack.enter_context(
            stand_in_kubelet(plane.kubeconfig, folder / "kubelet", nodes=NODES, replace=direct)
        )
        cluster = Cluster(plane.url, plane.ca, plane.token)
        stack.callback(cluster.close)
        _install(plane)
        queue: Queue[Slot] = Queue()
        for slot in made:
            queue.put(slot)
        yield World(folder, plane, cluster, hdfs, kubelet, write_library(folder / "library"), queue)


def _slot(stack: ExitStack, folder: Path, plane: ControlPlane, hdfs: HdfsCluster) -> Slot:
    api = stack.enter_context(Proxy(plane.url, plane.ca))
    storage = stack.enter_context(Proxy(f"http://{hdfs.address}"))
    return Slot(api, storage, api.kubeconfig(folder, plane.token))


def _install(plane: ControlPlane) -> None:
    """What the chart brings to a cluster, but for the operator itself."""
    for crd in sorted(CRDS.glob("*.yaml")):
        plane.kubectl("apply", "--server-side", "-f", str(crd))
    plane.kubectl("apply", "--server-side", "-f", "-", stdin=yaml.safe_dump_all(priority_classes()))
    plane.kubectl("wait", "--for=condition=Established", "crd", "--all")


def side_by_side() -> int:
    """How many runs go on at the same time: they mostly wait for controllers that look once a second."""
    return max(4, len(os.sched_getaffinity(0)))

"""Everything that one process has of one cluster: the wire, the memory, the watches, the port, the lease."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fleet_operator.cluster.credentials import Credentials
from fleet_operator.cluster.events import Recorder
from fleet_operator.cluster.kubernetes_cluster import KubernetesCluster
from fleet_operator.cluster.leases import KubernetesLeases
from fleet_operator.cluster.memory import Memory
from fleet_operator.cluster.transport import Transport
from fleet_operator.cluster.watches import Watches
from fleet_operator.resources.refs import ObjectRef


@dataclass(frozen=True)
class Connection:
    """Parts that know each other."""

    transport: Transport
    memory: Memory
    watches: Watches
    cluster: KubernetesCluster
    leases: KubernetesLeases


def connect(
    credentials: Credentials,
    lease: ObjectRef,
    namespaces: Sequence[str] = (),
    count: Callable[[str, int], None] = lambda verb, status: None,
    now: Callable[[], float] = time.time,
) -> Connection:
    """The parts, made; nothing is sent before the transport is entered (`async with`).

    Args:
        lease: The Lease that says which replica is at work.
        namespaces: What is watched; none means all.
        count: Told of each answer of the API server: verb, and HTTP status or 0.
        now: Seconds since the Unix epoch.
    """
    transport, memory = Transport(credentials, count=count), Memory()
    return Connection(
        transport=transport,
        memory=memory,
        watches=Watches(transport, memory, namespaces),
        cluster=KubernetesCluster(transport, memory, Recorder(transport, now)),
        leases=KubernetesLeases(transport, lease, now),
    )

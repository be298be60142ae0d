"""The Lease object that says which replica is at work."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

from fleet_operator.cluster.errors import NotFound
from fleet_operator.cluster.transport import Call, Transport
from fleet_operator.resources.refs import LEASE, Manifest, ObjectRef

TIMEOUT_S = 4.0
"""Shorter than what is left of a lease between two renewals: a late answer is of no use."""


@dataclass(frozen=True)
class LeaseRecord:
    """A Lease as it is in the cluster.

    Args:
        holder: Who is at work; "" when it was given back.
        duration_s: For how long others leave it alone when it is not renewed.
        transitions: How often it changed hands.
        acquired: When its holder got it, as Kubernetes writes times; "" for now.
        version: Its resourceVersion; "" for one that is not there yet.
    """

    holder: str = ""
    duration_s: float = 0.0
    transitions: int = 0
    acquired: str = ""
    version: str = ""


class KubernetesLeases:
    """One Lease of coordination.k8s.io/v1.

    Args:
        ref: Namespace and name.
        now: Seconds since the Unix epoch; for people, nobody decides by it.
    """

    def __init__(self, transport: Transport, ref: ObjectRef, now: Callable[[], float] = time.time) -> None:
        self._transport = transport
        self._ref = ref
        self._now = now
        self._uid = ""

    @property
    def uid(self) -> str:
        """Of the Lease, as it was last read or written: it tells one installation from all others; "" before that."""
        return self._uid

    async def read(self) -> LeaseRecord:
        """The Lease; an empty record when there is none.

        Raises:
            ClusterError: the API server does not say.
        """
        try:
            return self._record(await self._send("get", LEASE.path(self._ref.namespace, self._ref.name)))
        except NotFound:
            return LeaseRecord()

    async def write(self, record: LeaseRecord) -> LeaseRecord:
        """Write the Lease as renewed now, if it still is of the record's version; returns it as it is then.

        Raises:
            Conflict: somebody else was faster.
            ClusterError: the API server does not take it.
        """
        record = record if record.acquired else replace(record, acquired=self._stamp())
        body = self._body(record)
        if not record.version:
            return self._record(await self._send("create", LEASE.path(self._ref.namespace), body))
        return self._record(await self._send("update", LEASE.path(self._ref.namespace, self._ref.name), body))

    async def _send(self, verb: str, path: str, body: Manifest | None = None) -> dict[str, Any]:
        return await self._transport.send(Call(verb, path, body, tries=1, timeout_s=TIMEOUT_S, urgent=True))

    def _body(self, record: LeaseRecord) -> Manifest:
        metadata = {"name": self._ref.name, "namespace": self._ref.namespace}
        if record.version:
            metadata["resourceVersion"] = record.version
        spec: Manifest = {
            "holderIdentity": record.holder,
            "leaseDurationSeconds": max(1, round(record.duration_s)),
            "leaseTransitions": record.transitions,
            "acquireTime": record.acquired,
            "renewTime": self._stamp(),
        }
        return {"apiVersion": LEASE.api_version, "kind": LEASE.kind, "metadata": metadata, "spec": spec}

    def _record(self, body: Manifest) -> LeaseRecord:
        self._uid = body["metadata"].get("uid", "")
        return _record(body)

    def _stamp(self) -> str:
        return datetime.fromtimestamp(self._now(), UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def _record(body: Manifest) -> LeaseRecord:
    spec = body.get("spec", {})
    return LeaseRecord(
        holder=spec.get("holderIdentity") or "",
        duration_s=float(spec.get("leaseDurationSeconds") or 0),
        transitions=int(spec.get("leaseTransitions") or 0),
        acquired=spec.get("acquireTime") or "",
        version=body["metadata"]["resourceVersion"],
    )

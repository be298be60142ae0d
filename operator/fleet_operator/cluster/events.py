"""Events: the story of an object for people, told once and counted when it repeats."""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Callable
from datetime import UTC, datetime

from fleet_operator.cluster.errors import ClusterError, Conflict, NotFound
from fleet_operator.cluster.transport import MERGE, Call, Transport
from fleet_operator.resources import names
from fleet_operator.resources.refs import EVENT, Manifest, ObjectRef

log = logging.getLogger(__name__)

LONGEST_MESSAGE = 1024
"""Kubernetes refuses longer ones (API reference, Event v1 core)."""
REMEMBERED = 2000
_LONGEST_NAME = 253
_CLUSTER_NAMESPACE = "default"


class Recorder:
    """Posts Events; the same reason and message of the same object are one Event with a count.

    Args:
        now: Seconds since the Unix epoch.
    """

    def __init__(self, transport: Transport, now: Callable[[], float] = time.time) -> None:
        self._transport = transport
        self._now = now
        self._counts: dict[ObjectRef, int] = {}

    async def record(self, about: Manifest, kind: str, reason: str, message: str) -> None:
        """Post an Event, or count it up; what the API server thinks of it is only logged."""
        message = message if len(message) <= LONGEST_MESSAGE else message[: LONGEST_MESSAGE - 3] + "..."
        event = _event(about, kind, reason, message, _stamp(self._now()))
        ref = ObjectRef.of(event)
        try:
            self._remember(ref, await self._post(ref, event))
        except ClusterError as error:
            log.info("an Event was not posted: %s", error)

    async def _post(self, ref: ObjectRef, event: Manifest) -> int:
        """Post an Event; returns its count."""
        known = self._counts.get(ref, 0)
        if known:
            try:
                return await self._count_up(ref, event, known)
            except NotFound:  # the API server forgets Events after an hour
                pass
        try:
            await self._transport.send(Call("create", EVENT.path(ref.namespace), event, tries=2))
        except Conflict:  # posted before the operator was started again; an empty patch tells the count
            there = await self._patch(ref, {"lastTimestamp": event["lastTimestamp"]})
            return await self._count_up(ref, event, int(there.get("count") or 1))
        return 1

    async def _count_up(self, ref: ObjectRef, event: Manifest, known: int) -> int:
        await self._patch(ref, {"count": known + 1, "lastTimestamp": event["lastTimestamp"]})
        return known + 1

    async def _patch(self, ref: ObjectRef, body: Manifest) -> Manifest:
        return await self._transport.send(
            Call("patch", EVENT.path(ref.namespace, ref.name), body, content=MERGE, tries=2)
        )

    def _remember(self, ref: ObjectRef, count: int) -> None:
        self._counts.pop(ref, None)
        self._counts[ref] = count
        if len(self._counts) > REMEMBERED:
            self._counts.pop(next(iter(self._counts)))


def _event(about: Manifest, kind: str, reason: str, message: str, now: str) -> Manifest:
    metadata = about["metadata"]
    uid = metadata.get("uid", "")
    told = "\0".join((uid, about["kind"], kind, reason, message))
    digest = hashlib.blake2b(told.encode(), digest_size=8).hexdigest()
    namespace = metadata.get("namespace") or _CLUSTER_NAMESPACE
    return {
        "apiVersion": EVENT.api_version,
        "kind": EVENT.kind,
        "metadata": {"name": f"{metadata['name'][: _LONGEST_NAME - 17]}.{digest}", "namespace": namespace},
        "involvedObject": {
            "apiVersion": about["apiVersion"],
            "kind": about["kind"],
            "name": metadata["name"],
            "namespace": metadata.get("namespace", ""),
            "uid": uid,
        },
        "type": kind,
        "reason": reason,
        "message": message,
        "count": 1,
        "firstTimestamp": now,
        "lastTimestamp": now,
        "source": {"component": names.MANAGER},
        "reportingComponent": names.MANAGER,
    }


def _stamp(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")

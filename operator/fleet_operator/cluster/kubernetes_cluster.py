"""The real cluster: reads come from the memory of the watches, writes are server-side apply."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fleet_operator.cluster.errors import Conflict, Forbidden, Invalid, NotFound
from fleet_operator.cluster.events import Recorder
from fleet_operator.cluster.glance import head_of_object
from fleet_operator.cluster.memory import Memory, unpacked
from fleet_operator.cluster.transport import APPLY, STRATEGIC, Answer, Call, Transport
from fleet_operator.resources import names
from fleet_operator.resources.applied import mark_of, marked, seal
from fleet_operator.resources.refs import EVENT, JOB, POD, Kind, Manifest, ObjectRef, kind_of
from fleet_operator.resources.views import JobView, NodeView, PodView

_AS_APPLIED = {"fieldManager": names.MANAGER, "force": "true"}
_JOB_OF_POD = "batch.kubernetes.io/job-name"


class KubernetesCluster:
    """`Cluster` over one API server.

    Args:
        transport: Open.
        memory: Fed by the watches.
    """

    def __init__(self, transport: Transport, memory: Memory, recorder: Recorder) -> None:
        self._transport = transport
        self._memory = memory
        self._recorder = recorder
        # What is not watched is remembered instead: its hash, and the uid of its owner, with which it is forgotten.
        self._applied: dict[tuple[Kind, ObjectRef], tuple[str, str]] = {}

    def fleets(self) -> tuple[ObjectRef, ...]:
        """All FleetSpecs, from memory."""
        return tuple(self._memory.fleets)

    def fleet(self, ref: ObjectRef) -> Manifest | None:
        """A FleetSpec with its status, from memory."""
        entry = self._memory.fleets.get(ref)
        return None if entry is None else entry.view

    def jobs(self, ref: ObjectRef) -> tuple[JobView, ...]:
        """The Jobs of a fleet in the order of their names, from memory."""
        return tuple(self._memory.jobs.owned_by(ref))

    def missions(self, ref: ObjectRef) -> Mapping[int, Manifest]:
        """The Missions of a fleet by number, from memory."""
        return {int(body["spec"]["number"]): body for body in self._memory.missions.owned_by(ref)}

    def files(self, ref: ObjectRef) -> tuple[Manifest, ...]:
        """The ConfigMaps that carry a fleet's files, in the order of their names, from memory."""
        return tuple(unpacked(body) for body in self._memory.files.owned_by(ref))

    def nodes(self) -> tuple[NodeView, ...]:
        """The machines in the order of their names, from memory."""
        return tuple(self._memory.nodes.views())

    async def apply(self, manifest: Manifest) -> bool:
        """Have an object as this manifest says; False when the hash that was last seen or applied is the same."""
        kind, ref = kind_of(manifest), ObjectRef.of(manifest)
        sealed, watched = seal(manifest), self._memory.watches(manifest, kind)
        applied, _ = self._applied.get((kind, ref), ("", ""))
        if sealed.digest == (self._seen_hash(kind, ref) if watched else applied):
            return False
        path = kind.path(ref.namespace, ref.name)
        answer = await self._transport.ask(Call("patch", path, sealed.text, _AS_APPLIED, APPLY))
        if watched:
            self._memory.put(kind, _made(manifest, sealed.digest, answer))
        else:
            self._applied[kind, ref] = (sealed.digest, _owner_uid(manifest))
        if not answer.is_new and "deletionTimestamp" in answer.read()["metadata"]:
            self._applied.pop((kind, ref), None)
            raise Conflict(f"{kind.kind} {ref} is being deleted; it can be applied when it is gone", "Terminating")
        return True

    async def apply_status(self, kind: Kind, ref: ObjectRef, status: Manifest) -> bool:
        """Have an object's status as said; False when it was seen to be so."""
        entry = self._memory.store(kind).get(ref)
        if entry is None:
            self._memory.put(kind, await self._send_status(kind, ref, status))
            return True
        if entry.view.get("status") == status:
            return False
        try:
            answer = await self._send_status(kind, ref, status, str(entry.version))
        except Conflict:
            there = await self._transport.send(Call("get", kind.path(ref.namespace, ref.name)))
            self._memory.put(kind, there)
            if there["metadata"]["uid"] != entry.uid:
                raise
            answer = await self._send_status(kind, ref, status, there["metadata"]["resourceVersion"])
        self._memory.put(kind, answer)
        return True

    async def _send_status(self, kind: Kind, ref: ObjectRef, status: Manifest, version: str = "") -> Manifest:
        """Apply a status to an object of this version: what is said of one is not for another of the same name."""
        metadata = {"name": ref.name, "namespace": ref.namespace} | ({"resourceVersion": version} if version else {})
        body = {"apiVersion": kind.api_version, "kind": kind.kind, "metadata": metadata, "status": status}
        path = kind.path(ref.namespace, ref.name) + "/status"
        return await self._transport.send(Call("patch", path, body, _AS_APPLIED, APPLY))

    async def delete(self, kind: Kind, ref: ObjectRef, uid: str = "") -> None:
        """Delete an object, and in the background what it owns; one that is gone, or has another uid, is fine."""
        body: Manifest = {"propagationPolicy": "Background"}
        if uid:
            body["preconditions"] = {"uid": uid}
        try:
            answer = await self._transport.send(Call("delete", kind.path(ref.namespace, ref.name), body))
        except (NotFound, Conflict):
            answer = {}
        self._applied.pop((kind, ref), None)
        if not self._memory.knows(kind):
            return
        if "deletionTimestamp" in answer.get("metadata", {}) and self._memory.watches(answer, kind):
            self._memory.put(kind, answer)
        else:
            self._memory.forget(kind, ref, uid)

    async def pods(self, fleet: ObjectRef, job: str = "") -> tuple[PodView, ...]:
        """The Pods of a fleet, or of one of its Jobs, in the order of their names; one call."""
        selector = f"{names.FLEET_LABEL}={names.label_value(fleet.name)}" + (f",{_JOB_OF_POD}={job}" if job else "")
        bodies = await self._list(POD, fleet.namespace, {"labelSelector": selector})
        return tuple(sorted((PodView.of(body) for body in bodies), key=lambda pod: pod.ref))

    async def complaints(self, ref: ObjectRef, kind: str) -> tuple[tuple[str, str], ...]:
        """Reason and message of the Warning events about an object, newest first; one call."""
        about = f"involvedObject.kind={kind},involvedObject.name={ref.name},type=Warning"
        bodies = await self._list(EVENT, ref.namespace, {"fieldSelector": about})
        bodies.sort(key=lambda body: body.get("lastTimestamp") or body.get("eventTime") or "", reverse=True)
        return tuple((body.get("reason", ""), body.get("message", "")) for body in bodies)

    async def resize(self, pod: PodView, container: str, resources: Manifest) -> bool:
        """Change a running container's resources in place; False when the cluster or the node cannot, or it is gone."""
        path = POD.path(pod.ref.namespace, pod.ref.name) + "/resize"
        body = {"spec": {"containers": [{"name": container, "resources": resources}]}}
        try:
            await self._transport.send(Call("patch", path, body, content=STRATEGIC))
        except NotFound:
            return False
        except Invalid as error:
            # "Pod running on node without support for resize": its kubelet is older than the API server.
            if "support for resize" in str(error):
                return False
            raise
        except Forbidden as error:
            # The one kind of 403 that is no lack of rights: "node didn't have enough allocatable resources".
            if "allocatable" in str(error):
                return False
            raise
        return True

    async def record(self, about: Manifest, kind: str, reason: str, message: str) -> None:
        """Post an Event about an object; the same again counts up. Never raises."""
        await self._recorder.record(about, kind, reason, message)

    def forget_owner(self, uid: str) -> None:
        """A FleetSpec is gone: what was applied for it is no longer remembered."""
        self._applied = {key: (digest, owner) for key, (digest, owner) in self._applied.items() if owner != uid}

    def _seen_hash(self, kind: Kind, ref: ObjectRef) -> str:
        entry: Any = self._memory.store(kind).get(ref)
        if entry is None:
            return ""
        if kind == JOB:
            return str(entry.view.applied)
        return mark_of(unpacked(entry.view) if isinstance(entry.view, bytes) else entry.view)

    async def _list(self, kind: Kind, namespace: str, query: Mapping[str, str]) -> list[Manifest]:
        answer = await self._transport.send(Call("list", kind.path(namespace), query=query))
        return list(answer.get("items") or ())


def _made(manifest: Manifest, digest: str, answer: Answer) -> Manifest:
    """The object that came of a manifest; a new one is what was sent, and need not be read."""
    head = head_of_object(answer.content) if answer.is_new else None
    if head is None:
        return answer.read()
    body = marked(manifest, digest)
    told = {"uid": head.uid, "resourceVersion": head.version, "creationTimestamp": head.created}
    return {**body, "metadata": {**body["metadata"], **told}}


def _owner_uid(manifest: Manifest) -> str:
    owners = manifest["metadata"].get("ownerReferences", ())
    return next((str(owner["uid"]) for owner in owners), "")

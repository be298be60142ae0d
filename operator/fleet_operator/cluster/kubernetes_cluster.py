"""The real cluster: reads come from the memory of the watches, writes are server-side apply."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fleet_operator.cluster.errors import Conflict, Forbidden, Invalid, NotFound
from fleet_operator.cluster.events import Recorder
from fleet_operator.cluster.glance import head_of_object
from fleet_operator.cluster.memory import Memory, unpacked
from fleet_operator.cluster.shelves import FLEETS, MADE, MISSIONS, Shelf, shelf_of
from fleet_operator.cluster.store import Entry
from fleet_operator.cluster.transport import APPLY, STRATEGIC, Answer, Call, Transport
from fleet_operator.resources import names
from fleet_operator.resources.applied import mark_of, marked, seal
from fleet_operator.resources.refs import EVENT, POD, Kind, Manifest, ObjectRef, kind_of
from fleet_operator.resources.views import JobView, NodeView, PodView

_AS_APPLIED = {"fieldManager": names.MANAGER, "force": "true"}
_WITH_STATUS = {shelf.kind: shelf for shelf in (FLEETS, MISSIONS)}
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
        # In which version what is only made was applied last, and the uid of its owner, with which it is forgotten.
        self._applied: dict[tuple[Kind, ObjectRef], tuple[int, str]] = {}

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
        """Have an object as this manifest says; False when it was seen to be so.

        Raises:
            LookupError: its kind is not watched.
        """
        kind, ref = kind_of(manifest), ObjectRef.of(manifest)
        shelf, sealed = shelf_of(kind, manifest), seal(manifest)
        if shelf is None:
            raise LookupError(f"{kind.kind} {ref} is not watched: nobody would see whether it is there")
        if self._is_applied(shelf, ref, sealed.digest):
            return False
        path = kind.path(ref.namespace, ref.name)
        answer = await self._transport.ask(Call("patch", path, sealed.text, _AS_APPLIED, APPLY))
        made = _made(manifest, sealed.digest, answer)
        self._memory.put(shelf, made)
        if shelf in MADE:
            self._applied[kind, ref] = (int(made["metadata"]["resourceVersion"]), _owner_uid(manifest))
        if "deletionTimestamp" in made["metadata"]:
            self._applied.pop((kind, ref), None)
            raise Conflict(f"{kind.kind} {ref} is being deleted; it can be applied when it is gone", "Terminating")
        return True

    def _is_applied(self, shelf: Shelf, ref: ObjectRef, digest: str) -> bool:
        """Whether an object has the hash of a manifest, and nobody changed it since it was applied.

        Nobody else changes the spec of a Job or Mission, which cannot be changed. Who changes another object leaves
        the hash as it is; so it must be in the version in which it was applied, or was found by a new operator.
        """
        entry: Entry[Any] | None = self._memory.store(shelf).get(ref)
        if entry is None or digest != _mark(entry.view):
            return False
        return self._applied.get((shelf.kind, ref), (entry.version, ""))[0] == entry.version

    async def apply_status(self, kind: Kind, ref: ObjectRef, status: Manifest) -> bool:
        """Have an object's status as said; False when it was seen to be so."""
        shelf = _WITH_STATUS[kind]
        entry = self._memory.store(shelf).get(ref)
        if entry is None:
            self._memory.put(shelf, await self._send_status(kind, ref, status))
            return True
        if entry.view.get("status") == status:
            return False
        try:
            answer = await self._send_status(kind, ref, status, str(entry.version))
        except Conflict:
            there = await self._transport.send(Call("get", kind.path(ref.namespace, ref.name)))
            self._memory.put(shelf, there)
            if there["metadata"]["uid"] != entry.uid:
                raise
            answer = await self._send_status(kind, ref, status, there["metadata"]["resourceVersion"])
        self._memory.put(shelf, answer)
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
        shelf = shelf_of(kind, answer) if "deletionTimestamp" in answer.get("metadata", {}) else None
        if shelf is not None:
            self._memory.put(shelf, answer)
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

    async def _list(self, kind: Kind, namespace: str, query: Mapping[str, str]) -> list[Manifest]:
        answer = await self._transport.send(Call("list", kind.path(namespace), query=query))
        return list(answer.get("items") or ())


def _mark(view: Any) -> str:
    """The hash on an object, of what is kept of it."""
    if isinstance(view, str):
        return view
    if isinstance(view, JobView):
        return view.applied
    return mark_of(unpacked(view) if isinstance(view, bytes) else view)


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

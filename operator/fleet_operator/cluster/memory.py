"""What the watches have seen, in the small; and who is told when something of a fleet changes."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from fleet_operator.cluster.shelves import FILES, FLEETS, JOBS, MADE, MISSIONS, NODES, SHELVES, Shelf
from fleet_operator.cluster.store import Change, Store
from fleet_operator.resources import names
from fleet_operator.resources.applied import mark_of
from fleet_operator.resources.refs import Kind, Manifest, ObjectRef
from fleet_operator.resources.views import JobState, JobView, NodeView, owner_of

V = TypeVar("V")
_UNSEEN = ("managedFields", "selfLink")


@dataclass(frozen=True)
class Listeners:
    """Who is told.

    Args:
        changed: Something of this fleet changed; its FleetSpec may be gone.
        gone: This FleetSpec was deleted; its last body.
    """

    changed: Callable[[ObjectRef], None] = lambda ref: None
    gone: Callable[[ObjectRef, Manifest], None] = lambda ref, last: None


class Memory:
    """All watched objects."""

    def __init__(self) -> None:
        self.fleets: Store[Manifest] = Store(_lean, _itself)
        self.missions: Store[Manifest] = Store(_lean, owner_of)
        self.jobs: Store[JobView] = Store(JobView.of, owner_of)
        self.files: Store[bytes] = Store(_packed, _fleet_of_files)
        self.nodes: Store[NodeView] = Store(NodeView.of, lambda body: None)
        self.listeners = Listeners()
        self._stores: dict[Shelf, Store[Any]] = {
            FLEETS: self.fleets,
            MISSIONS: self.missions,
            JOBS: self.jobs,
            FILES: self.files,
            NODES: self.nodes,
            **{shelf: Store(mark_of, owner_of) for shelf in MADE},
        }

    def store(self, shelf: Shelf) -> Store[Any]:
        """The store of a shelf."""
        return self._stores[shelf]

    def has(self, shelf: Shelf, ref: ObjectRef, version: int) -> bool:
        """Whether an object is known in this version or a newer one."""
        entry = self._stores[shelf].get(ref)
        return entry is not None and entry.version >= version

    def put(self, shelf: Shelf, body: Manifest) -> None:
        """Take what a watch, a list, or the answer to an own write says of an object.

        The three race: an answer may hide what others wrote just before, as the watch then brings their change with a
        version that is no longer news. So it does not matter who brings it: the fleet is looked at again when there is
        something in it that the operator does not write itself.
        """
        change = self._stores[shelf].put(body)
        if change is not None and not _is_own(shelf, change):
            self._tell(shelf, change)

    def drop(self, shelf: Shelf, body: Mapping[str, Any]) -> None:
        """Take a watch's word that an object was deleted."""
        self._tell(shelf, self._stores[shelf].drop(body))

    def forget(self, kind: Kind, ref: ObjectRef, uid: str) -> None:
        """Take it that an own deletion was acknowledged."""
        for shelf in SHELVES:
            if shelf.kind == kind:
                self._tell(shelf, self._stores[shelf].forget(ref, uid))

    def replace(self, shelf: Shelf, refs: list[ObjectRef], version: int, namespace: str) -> None:
        """Remove what a list does not have."""
        for change in self._stores[shelf].replace(refs, version, namespace):
            self._tell(shelf, change)

    def _tell(self, shelf: Shelf, change: Change[Any] | None) -> None:
        if change is None:
            return
        before, after = change.before, change.after
        if shelf == FLEETS and before is not None and (after is None or after.uid != before.uid):
            self.listeners.gone(change.ref, before.view)
        owners = {entry.owner: None for entry in (before, after) if entry is not None}
        for owner in owners:
            if owner is not None:
                self.listeners.changed(owner)


def unpacked(body: bytes) -> Manifest:
    """A body as it was."""
    whole: Manifest = json.loads(zlib.decompress(body))
    return whole


def _packed(body: Manifest) -> bytes:
    """Files are read rarely, and are large: up to 1 MiB each."""
    return zlib.compress(json.dumps(_lean(body), separators=(",", ":")).encode(), 1)


def _lean(body: Manifest) -> Manifest:
    metadata = {key: value for key, value in body["metadata"].items() if key not in _UNSEEN}
    return {**body, "metadata": metadata}


def _itself(body: Mapping[str, Any]) -> ObjectRef:
    return ObjectRef.of(body)


def _fleet_of_files(body: Mapping[str, Any]) -> ObjectRef | None:
    name = body["metadata"].get("labels", {}).get(names.FILES_LABEL, "")
    return ObjectRef(body["metadata"].get("namespace", ""), name) if name else None


def _is_own(shelf: Shelf, change: Change[Any]) -> bool:
    """Whether the operator's own writes explain the whole change."""
    before, after = change.before, change.after
    if after is None:
        return False
    if shelf in MADE:  # a new mark is of an own write; whoever else changes an object leaves the mark as it is
        return before is None or before.view != after.view
    if before is None:
        return shelf == MISSIONS or (shelf == JOBS and after.view.state in _NEW)
    return before.uid == after.uid and _foreign(before.view) == _foreign(after.view)


def _foreign(view: Any) -> object:
    """What of an object others write."""
    if isinstance(view, JobView):
        return (view.state, view.deleting)
    if isinstance(view, dict):
        metadata = view["metadata"]
        return [metadata.get(key) for key in ("generation", "deletionTimestamp", "labels", "annotations")]
    return view


_NEW = (JobState.PENDING, JobState.SUSPENDED)

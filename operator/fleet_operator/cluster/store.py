"""The memory of one watch: the newest that was seen of each object, whoever brought it.

Three bring news of the same objects: the watch, lists, and answers to the operator's own writes. They come in any
order; `metadata.resourceVersion` says which is newer.

Source: Kubernetes, "API Concepts", Resource versions: those of one kind can be compared as numbers (KEP-5504).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from fleet_operator.resources.refs import Manifest, ObjectRef

V = TypeVar("V")
REMEMBERED_DELETIONS = 5000


@dataclass(frozen=True, slots=True)
class Entry(Generic[V]):
    """One object: its version, identity, owner, and what is kept of it."""

    version: int
    uid: str
    owner: ObjectRef | None
    view: V


@dataclass(frozen=True, slots=True)
class Change(Generic[V]):
    """What news came to: `before` or `after` is None when the object was not, or is no longer, there."""

    ref: ObjectRef
    before: Entry[V] | None
    after: Entry[V] | None


class Store(Generic[V]):
    """Objects of one kind, and which belong to whom.

    Args:
        shrink: What is kept of an object.
        owner: To whom it belongs.
    """

    def __init__(self, shrink: Callable[[Manifest], V], owner: Callable[[Manifest], ObjectRef | None]) -> None:
        self._shrink = shrink
        self._owner = owner
        self._entries: dict[ObjectRef, Entry[V]] = {}
        self._owned: dict[ObjectRef, dict[str, V]] = {}
        self._deleted: dict[ObjectRef, int] = {}
        self.newest = 0
        """The highest version that was seen of anything."""

    def __len__(self) -> int:
        return len(self._entries)

    def __iter__(self) -> Iterator[ObjectRef]:
        return iter(self._entries)

    def get(self, ref: ObjectRef) -> Entry[V] | None:
        """What is known of an object."""
        return self._entries.get(ref)

    def views(self) -> list[V]:
        """Of all objects, in the order of their names."""
        return [self._entries[ref].view for ref in sorted(self._entries)]

    def owned_by(self, owner: ObjectRef) -> list[V]:
        """Of the objects of an owner, in the order of their names."""
        return [view for _, view in sorted(self._owned.get(owner, {}).items())]

    def put(self, body: Manifest) -> Change[V] | None:
        """Take news of an object; None when it is not news."""
        ref = ObjectRef.of(body)
        version = int(body["metadata"]["resourceVersion"])
        before = self._entries.get(ref)
        if version <= self._deleted.get(ref, -1) or (before is not None and version <= before.version):
            return None
        self.newest = max(self.newest, version)
        after = Entry(version, body["metadata"].get("uid", ""), self._owner(body), self._shrink(body))
        self._set(ref, before, after)
        return Change(ref, before, after)

    def drop(self, body: Mapping[str, Any]) -> Change[V] | None:
        """Take news of a deletion; None when the object is not there, or was made anew since."""
        ref = ObjectRef.of(body)
        version = int(body["metadata"]["resourceVersion"])
        self.newest = max(self.newest, version)
        before = self._entries.get(ref)
        if before is not None and before.version > version:
            return None
        return self._remove(ref, version)

    def forget(self, ref: ObjectRef, uid: str = "") -> Change[V] | None:
        """Take it that a deletion was acknowledged; None when another object has the name."""
        before = self._entries.get(ref)
        if before is None or (uid and before.uid != uid):
            return None
        return self._remove(ref, before.version)

    def replace(self, refs: Iterable[ObjectRef], version: int, namespace: str = "") -> list[Change[V]]:
        """Remove what a list, whose objects were all put, does not have; what is newer than the list stays.

        Args:
            refs: What the list has.
            version: Of the list.
            namespace: Of the list; "" for all.
        """
        listed = set(refs)
        gone = [ref for ref, entry in self._within(namespace) if ref not in listed and entry.version <= version]
        return [change for ref in gone if (change := self._remove(ref, version)) is not None]

    def put_back(self, version: int, namespace: str = "") -> None:
        """Take it that the cluster's history was put back to a version: what was seen since counts for nothing."""
        self.newest = version
        self._deleted.clear()
        for ref, entry in self._within(namespace):
            self._entries[ref] = Entry(-1, entry.uid, entry.owner, entry.view)

    def _within(self, namespace: str) -> list[tuple[ObjectRef, Entry[V]]]:
        return [(ref, entry) for ref, entry in self._entries.items() if not namespace or ref.namespace == namespace]

    def _remove(self, ref: ObjectRef, version: int) -> Change[V] | None:
        before = self._entries.get(ref)
        self._set(ref, before, None)
        self._deleted[ref] = max(version, self._deleted.pop(ref, -1))
        if len(self._deleted) > REMEMBERED_DELETIONS:
            self._deleted.pop(next(iter(self._deleted)))
        return None if before is None else Change(ref, before, None)

    def _set(self, ref: ObjectRef, before: Entry[V] | None, after: Entry[V] | None) -> None:
        if before is not None and before.owner is not None:
            self._disown(before.owner, ref.name)
        if after is None:
            self._entries.pop(ref, None)
            return
        self._entries[ref] = after
        if after.owner is not None:
            self._owned.setdefault(after.owner, {})[ref.name] = after.view

    def _disown(self, owner: ObjectRef, name: str) -> None:
        owned = self._owned[owner]
        owned.pop(name, None)
        if not owned:
            del self._owned[owner]

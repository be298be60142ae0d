"""The port to storage: what the roles may rely on, whether a folder or HDFS is behind it.

Objects are named by paths such as `default/crop-scouting/missions/0001/evaluation.json`: parts of letters, digits,
`.`, `_` and `-`, joined by `/`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable


@dataclass(frozen=True, order=True)
class Entry:
    """One object in a listing."""

    path: str
    size_bytes: int


class Storage(Protocol):
    """Whole objects, appended logs and listings. Every call may raise StorageUnavailable; trying again is safe."""

    @property
    def uri(self) -> str:
        """Address that opens the same storage again: `file:///...`."""

    def read(self, path: str) -> bytes:
        """The whole object.

        Raises:
            ObjectNotFound: no object has this path.
        """

    def write(self, path: str, data: bytes) -> None:
        """Make or replace a whole object; readers see the old one or the new one, and a crash leaves one of them.

        The object is durable when the call returns.

        Raises:
            StorageFull, StorageReadOnly: nothing has changed.
        """

    def append(self, path: str, data: bytes) -> None:
        """Add to the end of an object, made when it is not there; one writer at a time.

        The data is durable when the call returns. A crash in the call may leave a part of the data at the end.

        Raises:
            StorageFull, StorageReadOnly: the caller must take the data as not written.
        """

    def list(self, prefix: str) -> list[Entry]:
        """All objects under a folder, at any depth, sorted by path; empty when there is none."""

    def exists(self, path: str) -> bool:
        """Whether an object has this path."""

    def delete(self, prefix: str) -> None:
        """Remove an object, or a folder with all that is under it; nothing happens when there is none."""


@runtime_checkable
class Located(Protocol):
    """A storage that knows which machines hold its objects."""

    def locations(self, prefix: str) -> Mapping[str, int]:
        """Bytes that each machine holds of the objects under a folder, by the machine's host name or address."""

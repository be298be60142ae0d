"""Storage that changes nothing once another replica may be at work.

A pass works in threads, which go on for a while after its lease is lost: what they delete late may be what the next
leader has just written. The API server is fenced in the same way, see `cluster.transport`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from fleet.storage.limits import within
from fleet.storage.port import Entry, Located, Storage
from fleet_operator.cluster.errors import NotLeading
from fleet_operator.reconcile.copies import Copied

Opened = Callable[[str], Storage]
SMALL_BYTES = 1 << 20
"""Objects up to this size must be written while the lease lasts; larger ones are contexts, which stay the same."""


def fenced(opened: Opened, left_s: Callable[[], float]) -> Opened:
    """Opens storages behind a fence.

    Args:
        opened: Opens a storage by its address.
        left_s: Says for how many seconds this process may still write.
    """

    def behind_a_fence(uri: str) -> Storage:
        storage = opened(uri)
        return LocatedBehindFence(storage, left_s) if isinstance(storage, Located) else BehindFence(storage, left_s)

    return behind_a_fence


@dataclass(frozen=True)
class BehindFence:
    """A storage of which every change asks first whether this process holds the lease, and is not tried for longer.

    Raises: as the storage itself; and NotLeading when a change was not begun.
    """

    inner: Storage
    left_s: Callable[[], float]

    @property
    def uri(self) -> str:
        """Address of the storage."""
        return self.inner.uri

    def read(self, path: str) -> bytes:
        """The whole object."""
        return self.inner.read(path)

    def write(self, path: str, data: bytes) -> None:
        """Make or replace a whole object."""
        with self._leading("write", path, len(data)):
            self.inner.write(path, data)

    def append(self, path: str, data: bytes) -> None:
        """Add to the end of an object."""
        with self._leading("append to", path, len(data)):
            self.inner.append(path, data)

    def list(self, prefix: str) -> list[Entry]:
        """All objects under a folder."""
        return self.inner.list(prefix)

    def exists(self, path: str) -> bool:
        """Whether an object has this path."""
        return self.inner.exists(path)

    def delete(self, prefix: str) -> None:
        """Remove an object or a folder."""
        with self._leading("delete", prefix):
            self.inner.delete(prefix)

    def check_copies(self) -> None:
        """Write a small file, to see that the storage keeps as many copies as it is asked for."""
        if isinstance(self.inner, Copied):
            with self._leading("write", "a file"):
                self.inner.check_copies()

    @contextmanager
    def _leading(self, verb: str, path: str, size_bytes: int = 0) -> Iterator[None]:
        left_s = self.left_s()
        if left_s <= 0.0:
            raise NotLeading(f"{verb} {path} in {self.uri}: not done, as another process may hold the lease by now")
        with within(left_s if size_bytes <= SMALL_BYTES else math.inf):
            yield


@dataclass(frozen=True)
class LocatedBehindFence(BehindFence):
    """The same of a storage that knows where its objects are."""

    def locations(self, prefix: str) -> Mapping[str, int]:
        """Bytes of a folder's objects by machine."""
        return self.inner.locations(prefix) if isinstance(self.inner, Located) else {}

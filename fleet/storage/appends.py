"""Appending to files of HDFS: a look and a request where all is well, and nothing twice where it is not.

Over a network nobody may know whether an append was taken, and one that seems lost may still arrive. So what is in
doubt is not sent again: the file is written anew with what it must have and renamed over the old one. The first append
of a process to a file does the same. So the file of a process that writes to it is its own one, and a process that was
given up finds another file, or another size, when it looks before its next append: it writes no more.

HDFS appends by path, and has no way to say "if it still is this file". What remains are the instants between a look and
what follows it: the data of an append that was under way when the file was replaced may be lost though it was
acknowledged to the process that was given up, or be added to the new file, where it may be twice.
"""

from __future__ import annotations

import contextlib
import threading
from collections import OrderedDict
from dataclasses import dataclass, replace

from fleet.storage.hdfs_files import HdfsFiles, no_matter
from fleet.storage.patience import Patience
from fleet.storage.webhdfs_answers import Fate, Refused

_MOST = 256
"""Files to remember; one that was forgotten is read again before the next append."""
_LEASE_S = 3.0
"""How long to wait for another writer's end before he is shut out."""


class Changed(Exception):
    """The file is not as this process last saw it. It never leaves the storage."""


@dataclass(frozen=True)
class _Known:
    """A file as this process knows it.

    Args:
        size_bytes: All that was acknowledged, or read.
        ours: This process has made the file, so that no append of an earlier writer can still reach it.
        number: Of the file that this process has made; 0 while it has not looked.
        node: Where the last append was sent to.
        doubtful: Appends that were not acknowledged: one of them, or a part of it, may be after `size_bytes`.
    """

    size_bytes: int
    ours: bool = False
    number: int = 0
    node: str = ""
    doubtful: tuple[bytes, ...] = ()

    def base_of(self, content: bytes) -> bytes:
        """The part of the file's content that is acknowledged. Raises Changed when it is not the one that is known."""
        rest = content[self.size_bytes :]
        if len(content) < self.size_bytes or not any(data.startswith(rest) for data in (b"", *self.doubtful)):
            raise Changed
        return content[: self.size_bytes]


class Appends:
    """Appends of one process, and what it needs to know of the files. Many threads may use it, one for each file."""

    def __init__(self, files: HdfsFiles, patience_s: float) -> None:
        self._files, self._patience_s = files, patience_s
        self._known: OrderedDict[str, _Known | None] = OrderedDict()
        self._lock = threading.Lock()

    def append(self, path: str, data: bytes) -> None:
        """Add to the end of a file, made when it is not there.

        Raises:
            Refused: as HdfsFiles; the file has nothing of the data, or the next append will see to that.
            Changed: another process has written to the file since this one read it or appended to it.
        """
        known = self._get(path)
        if known is not None and known.ours and not known.doubtful:
            known = self._looked_at(path, known)
        if known is None or not known.ours or known.doubtful or not self._send(path, data, known):
            self._take_over(path, data)

    def was_read(self, path: str, size_bytes: int) -> None:
        """Remember a look at a file; what this process itself appends to is known better than by a look."""
        known = self._get(path)
        if known is None or not known.ours:
            self._put(path, _Known(size_bytes))

    def was_made(self, path: str, size_bytes: int) -> None:
        """Remember that this process has made or replaced a file."""
        self._put(path, _Known(size_bytes, ours=True))

    def forget(self, path: str) -> None:
        """Forget a file or a folder that is removed."""
        with self._lock:
            for known in [known for known in self._known if known == path or known.startswith(f"{path}/")]:
                del self._known[known]

    def _looked_at(self, path: str, known: _Known) -> _Known | None:
        """What is known of a file, after a look whether another process has written to it; None when it is gone.

        Raises:
            Changed: one has.
        """
        try:
            found = self._files.status(path)
        except Refused as refused:
            if refused.fate is not Fate.ABSENT:
                raise
            self.forget(path)
            return None
        if found.size_bytes != known.size_bytes or known.number not in (0, found.number):
            self._put(path, _Known(-1))  # until it is read again
            raise Changed
        return replace(known, number=found.number)

    def _send(self, path: str, data: bytes, known: _Known) -> bool:
        """Append by one request. False when nobody knows what became of it, or another writer is in the way."""
        if not data:
            return True
        self._put(path, replace(known, doubtful=(data,)))
        patience, lease = Patience(self._patience_s), Patience(_LEASE_S)
        node, avoid = known.node, self._files.silent()
        while True:
            try:
                node = self._files.door.append(path, data, node, avoid)
            except Refused as refused:
                again = (refused.fate is Fate.LEASED and lease.wait()) or (
                    refused.fate is Fate.PASSING and not refused.sent and patience.wait(refused.wait_s)
                )
                if not again:
                    return self._has_failed(path, known, refused)
                if refused.fate is Fate.PASSING:
                    node, avoid = "", self._files.avoiding(avoid, refused)
            else:
                self._put(path, replace(known, size_bytes=known.size_bytes + len(data), node=node))
                return True

    def _has_failed(self, path: str, known: _Known, refused: Refused) -> bool:
        """False when the file is to be taken over; raises Refused when that would be of no use."""
        match refused.fate:
            case Fate.ABSENT:
                self.forget(path)
                return False
            case Fate.LEASED | Fate.PASSING | Fate.NO_NODES if refused.sent:
                return False
            case Fate.FULL:  # blocks before the one that did not fit may be there
                with contextlib.suppress(Refused):
                    self._files.truncate(path, known.size_bytes)
                    self._put(path, replace(known, node=""))
            case _:
                self._put(path, replace(known, node=""))
        raise refused

    def _take_over(self, path: str, data: bytes) -> None:
        """Write the file anew with what it must have, and the data after it."""
        content: bytes | None = None
        with no_matter(Fate.ABSENT):
            content = self._files.read(path)
        try:
            known = self._get(path) or _Known(len(content or b""))
            base = known.base_of(content or b"")
        except Changed:
            self._put(path, _Known(-1))  # until it is read again
            raise
        if data or content is None:
            self._put(path, replace(known, size_bytes=len(base), doubtful=(*known.doubtful, data)))
            number = self._files.replace(path, base + data, numbered=True)
            self._put(path, _Known(len(base) + len(data), ours=True, number=number))

    def _get(self, path: str) -> _Known | None:
        with self._lock:
            return self._known.get(path)

    def _put(self, path: str, known: _Known) -> None:
        with self._lock:
            self._known[path] = known
            self._known.move_to_end(path)
            if len(self._known) > _MOST:
                self._known.popitem(last=False)

"""Files of HDFS: calls are repeated while what is wrong may pass, and a file is replaced as a whole."""

from __future__ import annotations

import contextlib
import time
import uuid
from collections.abc import Callable, Iterator
from typing import TypeVar

from fleet.storage.patience import Patience
from fleet.storage.webhdfs import Block, FileStatus, WebHdfs
from fleet.storage.webhdfs_answers import Fate, Refused

SPACE_S = 15.0
"""How long to wait for DataNodes that take a block: when all are full, nothing changes by waiting."""
_TIDY_S = 5.0
_CUT_S = 20.0
_AVOID_S = 60.0
"""How long a DataNode that gave no answer is not gone to: a NameNode needs minutes to notice that one is gone."""
_ATTEMPTS = 5
"""How often a write starts anew because another process deletes its folder."""
_LONGEST_NAME = 200
_MAY_PASS = {Fate.PASSING, Fate.LEASED, Fate.UNCLOSED}
T = TypeVar("T")


class HdfsFiles:
    """Files by their whole paths in HDFS; many threads may use it.

    Every call may raise Refused, after `patience_s` when what is wrong may pass.
    """

    def __init__(self, door: WebHdfs, patience_s: float) -> None:
        self.door = door
        self._patience_s = patience_s
        self._silent: dict[str, float] = {}

    def read(self, path: str) -> bytes:
        """A whole file.

        One that its writer left open by dying can be unreadable. HDFS closes it when another wants to write, after the
        minute that each writer is given; by itself only after 20 minutes.
        """

        def attempt(avoid: set[str]) -> bytes:
            try:
                return self.door.read(path, avoid)
            except Refused as refused:
                if refused.fate is Fate.UNCLOSED:
                    with contextlib.suppress(Refused):
                        self.door.append(path, b"", "", avoid)
                raise

        return self.patiently(attempt)

    def status(self, path: str) -> FileStatus:
        """What a path is."""
        return self.patiently(lambda _: self.door.status(path))

    def contents(self, path: str) -> list[FileStatus]:
        """What is in a folder."""
        return self.patiently(lambda _: self.door.contents(path))

    def blocks(self, path: str) -> list[Block]:
        """Where a file is."""
        return self.patiently(lambda _: self.door.blocks(path))

    def delete(self, path: str) -> None:
        """Remove a file or a folder; nothing happens when there is none."""
        with no_matter(Fate.ABSENT, Fate.NO_FOLDER):
            self.patiently(lambda _: self.door.delete(path))

    def replace(self, path: str, data: bytes, numbered: bool = False) -> int:
        """Make or replace a file as a whole: readers see the old or the new one, and who appends to it finds out.

        Args:
            numbered: Whether the number of the new file is wanted, which costs a call.

        Returns:
            Its number, or 0.
        """
        folder, _, name = path.rpartition("/")
        for attempt in range(_ATTEMPTS):
            temporary = f"{folder}/~{name[:_LONGEST_NAME]}~{uuid.uuid4().hex[:8]}"
            try:
                return self._write_beside(path, temporary, data, numbered)
            except Refused as refused:
                # Absent: another process deleted the folder. Or an answer was lost, and the rename was done: twice is
                # as good as once.
                if refused.fate is not Fate.ABSENT or attempt == _ATTEMPTS - 1:
                    self.tidy(temporary)
                    raise
        return 0

    def _write_beside(self, path: str, temporary: str, data: bytes, numbered: bool) -> int:
        self.patiently(lambda avoid: self.door.create(temporary, data, avoid))
        number = self.status(temporary).number if numbered else 0  # asked now, as another may rename over it at once
        self.patiently(lambda _: self.door.rename(temporary, path))
        return number

    def truncate(self, path: str, size_bytes: int) -> None:
        """Cut a file off at its first bytes, and wait until it may be appended to again."""
        self.patiently(lambda _: self.door.truncate(path, size_bytes), _CUT_S)

    def tidy(self, path: str) -> None:
        """Remove what nobody needs, as far as that can be done now."""
        with contextlib.suppress(Refused):
            self.patiently(lambda _: self.door.delete(path), _TIDY_S)

    def patiently(self, call: Callable[[set[str]], T], most_s: float | None = None) -> T:
        """Repeat a call while its refusal may pass.

        Args:
            call: Given the DataNodes to avoid: those that failed in this operation.
        """
        patience, space = Patience(self._patience_s if most_s is None else most_s), None
        avoid = self.silent()
        while True:
            try:
                return call(avoid)
            except Refused as refused:
                avoid = self.avoiding(avoid, refused)
                if refused.fate is Fate.NO_NODES:
                    space = space or Patience(min(SPACE_S, self._patience_s))
                    goes_on = space.wait()
                else:
                    goes_on = refused.fate in _MAY_PASS and patience.wait(refused.wait_s)
                if not goes_on:
                    raise

    def silent(self) -> set[str]:
        """DataNodes that gave no answer lately."""
        now = time.monotonic()
        return {node for node, since in list(self._silent.items()) if now - since < _AVOID_S}

    def avoiding(self, avoid: set[str], refused: Refused) -> set[str]:
        """The DataNodes to avoid after a refusal: none when it is the NameNode's own, as it may have none left."""
        if not refused.node:
            self._silent.clear()
            return set()
        if refused.fate is not Fate.PASSING:
            return avoid
        self._silent[refused.node] = time.monotonic()
        return avoid | {refused.node}


@contextlib.contextmanager
def no_matter(*fates: Fate) -> Iterator[None]:
    """Let refusals of these kinds pass."""
    try:
        yield
    except Refused as refused:
        if refused.fate not in fates:
            raise

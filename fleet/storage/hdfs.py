"""Storage in HDFS over WebHDFS.

An object is a file. A whole object is written to `~NAME~xxxxxxxx` beside it and renamed over it, so readers see the old
or the new one. `~` is in no object's name, so such files are never listed; what a killed writer left is removed later.
"""

from __future__ import annotations

import contextlib
import uuid
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from fleet.clock import SystemClock
from fleet.errors import ObjectNotFound, StorageError
from fleet.storage.appends import Appends, Changed
from fleet.storage.hdfs_files import HdfsFiles
from fleet.storage.limits import Limits
from fleet.storage.paths import folder_parts, is_part, object_parts
from fleet.storage.patience import Patience
from fleet.storage.port import Entry
from fleet.storage.webhdfs import FileStatus, WebHdfs
from fleet.storage.webhdfs_address import WebHdfsAddress
from fleet.storage.webhdfs_answers import Act, Fate, Refused

PATIENCE_S = 120.0
"""How long an operation is tried; a NameNode that starts again needs a part of a minute."""
COPIES_S = 5.0
_LEFTOVER_S = 3600.0
_NOTHING = {Fate.ABSENT, Fate.NO_FOLDER}


@dataclass(frozen=True)
class HdfsStorage:
    """A folder of HDFS as storage; it is made at the first write.

    Args:
        address: Where it is.
        patience_s: How long each operation is tried.
        limits: What one call may take.
    Errors: as in the port. Wrong paths raise StorageError. An append to an object that another process has changed
    since this one read it or appended to it raises StorageError, until it is read again.
    """

    address: WebHdfsAddress
    patience_s: float = PATIENCE_S
    limits: Limits = field(default=Limits(), repr=False)
    _files: HdfsFiles = field(init=False, repr=False, compare=False)
    _appends: Appends = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        files = HdfsFiles(WebHdfs(self.address, self.limits), self.patience_s)
        object.__setattr__(self, "_files", files)
        object.__setattr__(self, "_appends", Appends(files, self.patience_s))

    def __reduce__(self) -> tuple[type[HdfsStorage], tuple[WebHdfsAddress, float, Limits]]:
        return HdfsStorage, (self.address, self.patience_s, self.limits)

    @property
    def uri(self) -> str:
        """`webhdfs://`, user, NameNode and folder."""
        return str(self.address)

    def read(self, path: str) -> bytes:
        """The whole object; ObjectNotFound when there is none."""
        file = self._file(path)
        with self._translated("read", path):
            try:
                data = self._files.read(file)
            except Refused as refused:
                if refused.fate in _NOTHING:
                    self._appends.was_read(file, 0)
                raise
            self._appends.was_read(file, len(data))
            return data

    def write(self, path: str, data: bytes) -> None:
        """Make or replace a whole object, durable and all or nothing."""
        file = self._file(path)
        with self._translated("write", path, changes=True):
            self._files.replace(file, data)
            self._appends.was_made(file, len(data))

    def append(self, path: str, data: bytes) -> None:
        """Add to the end of an object, durable; on an error the caller must take the data as not written."""
        file = self._file(path)
        with self._translated("append to", path, changes=True):
            self._appends.append(file, data)

    def list(self, prefix: str) -> list[Entry]:
        """All objects under a folder, sorted by path."""
        folder = "/".join((self.address.root, *folder_parts(prefix)))
        with self._translated("list", prefix):
            return sorted(self._entries(folder, f"{prefix}/" if prefix else ""))

    def exists(self, path: str) -> bool:
        """Whether an object has this path."""
        file = self._file(path)
        with self._translated("look for", path):
            try:
                return not self._files.status(file).is_folder
            except Refused as refused:
                if refused.fate in _NOTHING:
                    return False
                raise

    def delete(self, prefix: str) -> None:
        """Remove an object or a folder; never the whole storage."""
        file = self._file(prefix)
        with self._translated("delete", prefix, changes=True):
            self._appends.forget(file)
            self._files.delete(file)

    def locations(self, prefix: str) -> Mapping[str, int]:
        """Bytes of a folder's objects that each DataNode has, by its host name or address."""
        held: dict[str, int] = {}
        for entry in self.list(prefix):
            with contextlib.suppress(ObjectNotFound), self._translated("find the blocks of", entry.path):
                for block in self._files.blocks(self._file(entry.path)):
                    for host in block.hosts:
                        held[host] = held.get(host, 0) + block.size_bytes
        return held

    def copies(self, path: str) -> int:
        """How many DataNodes have the whole object; as many as are asked for when it has no bytes."""
        file = self._file(path)
        with self._translated("find the blocks of", path):
            return self._copies(file)

    def check_copies(self) -> None:
        """Write a small file, to see that the storage keeps as many copies as it is asked for.

        Raises:
            StorageError: it keeps fewer; says what to change.
        """
        file = f"{self.address.root}/~check~{uuid.uuid4().hex[:8]}"
        asked, patience = self.address.replication, Patience(COPIES_S)
        with self._translated("write", "a file", changes=True):
            try:
                self._files.replace(file, b"as many copies as asked for?")
                while (kept := self._copies(file)) < asked and patience.wait():
                    continue
            finally:
                self._files.tidy(file)
        if kept < asked:
            raise StorageError(
                f"{self.uri} keeps {kept} of {asked} copies of what it has acknowledged; start {asked} DataNodes and "
                f"set dfs.namenode.replication.min to {asked}, or ask for fewer copies (storage.replication)"
            )

    def _copies(self, file: str) -> int:
        return min((len(block.hosts) for block in self._files.blocks(file)), default=self.address.replication)

    def _file(self, path: str) -> str:
        return "/".join((self.address.root, *object_parts(path)))

    def _entries(self, folder: str, prefix: str) -> Iterator[Entry]:
        """What is under a folder; objects that vanish meanwhile are left out."""
        try:
            found = self._files.contents(folder)
        except Refused as refused:
            if refused.fate in _NOTHING:
                return
            raise
        for item in found:
            path = f"{prefix}{item.name}"
            if not is_part(item.name):
                self._clear(f"{folder}/{item.name}", item)
            elif not item.is_folder:
                yield Entry(path, item.size_bytes)
            elif item.children:
                yield from self._entries(f"{folder}/{item.name}", f"{path}/")

    def _clear(self, file: str, item: FileStatus) -> None:
        """Remove what a writer left that was killed long ago; one that still lives would write it anew."""
        if item.name.startswith("~") and not item.is_folder and SystemClock().now() - item.modified_s > _LEFTOVER_S:
            self._files.tidy(file)

    @contextlib.contextmanager
    def _translated(self, verb: str, path: str, *, changes: bool = False) -> Iterator[None]:
        """Turn refusals of HDFS into the library's own errors."""
        try:
            yield
        except Refused as refused:
            room = self._files.door.room() if refused.fate is Fate.NO_NODES else []
            raise Act(verb, path, self.address, changes).error(refused, self.patience_s, room) from refused
        except Changed as changed:
            raise StorageError(
                f"cannot append to {path} in {self.uri}: another process has written to it since this one last looked; "
                "let one process append to it at a time, and read it again first"
            ) from changed

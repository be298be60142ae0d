"""Storage in a local directory.

An object is a file. A whole object is written to `~NAME~` beside it and renamed, so readers see the old or the new
one; `~` is in no object's name, so such files are never listed. The writer holds a lock on the temporary file: the
one that a killed writer left is taken over by the next writer of the same object.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import shutil
import stat
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from fleet.errors import ObjectNotFound, StorageError, StorageFull, StorageReadOnly, StorageUnavailable
from fleet.storage.limits import Limits, too_large
from fleet.storage.paths import folder_parts, is_part, object_parts
from fleet.storage.port import Entry

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_READ_ONLY = {errno.EROFS, errno.EACCES, errno.EPERM}
_ABSENT = (FileNotFoundError, NotADirectoryError, IsADirectoryError)
_ATTEMPTS = 5
"""How often a write starts anew because another process deletes its folder."""


@dataclass(frozen=True)
class LocalStorage:
    """A directory as storage; it is made at the first write.

    Args:
        root: The directory.
        limits: What one call may take; only sizes count.
    Errors: as in the port. Wrong paths raise StorageError.
    """

    root: Path
    limits: Limits = field(default=Limits(), repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "root", Path(self.root).absolute())

    @property
    def uri(self) -> str:
        """`file://` and the directory."""
        return self.root.as_uri()

    def read(self, path: str) -> bytes:
        """The whole object; ObjectNotFound when there is none."""
        file = self._file(path)
        try:
            return _content(file, self.limits.object_bytes)
        except _ABSENT as error:
            raise ObjectNotFound(f"there is no object {path} in {self.uri}") from error
        except OSError as error:
            raise _unavailable(error, f"read {file}") from error

    def write(self, path: str, data: bytes) -> None:
        """Make or replace a whole object, durable and all or nothing."""
        file = self._file(path)
        with _translated(f"write {file}"):
            for attempt in range(_ATTEMPTS):
                _make_folder(file.parent)
                try:
                    return _replace(file, data)
                except FileNotFoundError:  # another process deleted the folder
                    if attempt == _ATTEMPTS - 1:
                        raise
        return None

    def append(self, path: str, data: bytes) -> None:
        """Add to the end of an object, durable; on an error the object is as it was."""
        file = self._file(path)
        with _translated(f"append to {file}"):
            _make_folder(file.parent)
            _append(file, data)

    def list(self, prefix: str) -> list[Entry]:
        """All objects under a folder, sorted by path."""
        folder = self.root.joinpath(*folder_parts(prefix))
        try:
            return sorted(_entries(folder, f"{prefix}/" if prefix else ""))
        except OSError as error:
            raise _unavailable(error, f"list {folder}") from error

    def exists(self, path: str) -> bool:
        """Whether an object has this path."""
        file = self._file(path)
        try:
            return file.is_file()
        except OSError as error:
            raise _unavailable(error, f"look for {file}") from error

    def delete(self, prefix: str) -> None:
        """Remove an object or a folder; never the whole storage."""
        file = self._file(prefix)
        with _translated(f"delete {file}"):
            try:
                if file.is_dir() and not file.is_symlink():
                    shutil.rmtree(file)
                else:
                    file.unlink()
            except _ABSENT:
                return
            _sync_folder(file.parent)

    def _file(self, path: str) -> Path:
        return self.root.joinpath(*object_parts(path))


def _entries(folder: Path, prefix: str) -> Iterator[Entry]:
    """What is under a folder; objects that vanish meanwhile are left out."""
    try:
        found = list(os.scandir(folder))
    except _ABSENT:
        return
    for item in found:
        if not is_part(item.name):
            continue
        path = f"{prefix}{item.name}"
        if item.is_dir():
            yield from _entries(Path(item.path), f"{path}/")
        else:
            with contextlib.suppress(*_ABSENT):
                yield Entry(path, item.stat().st_size)


def _content(file: Path, most_bytes: int) -> bytes:
    """A whole file. A pipe or a device is no object: reading it might never end.

    Raises:
        StorageError: it is larger than what may be read.
    """
    descriptor = os.open(file, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    with os.fdopen(descriptor, "rb") as opened:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            raise FileNotFoundError(errno.ENOENT, "no regular file", str(file))
        data = b"" if found.st_size > most_bytes else opened.read(most_bytes + 1)
    if max(len(data), found.st_size) > most_bytes:
        raise StorageError(f"cannot read {file}: {too_large(found.st_size, most_bytes)}")
    return data


def _replace(file: Path, data: bytes) -> None:
    """Write beside the object, then rename. Raises FileNotFoundError when the folder was deleted meanwhile."""
    temporary = file.with_name(f"~{file.name}~")
    descriptor = _open_locked(temporary)
    try:
        try:
            os.ftruncate(descriptor, 0)
            _write_all(descriptor, data)
            os.fsync(descriptor)
            temporary.replace(file)
        except OSError:
            with contextlib.suppress(OSError):  # the first error is the one to tell
                temporary.unlink()
            raise
        _sync_folder(file.parent)
    finally:
        os.close(descriptor)


def _open_locked(temporary: Path) -> int:
    """A descriptor of the temporary file, which nobody else may use until it is closed.

    Who waited for the lock holds a file that was renamed meanwhile, and must open the new one.
    """
    while True:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            with contextlib.suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(descriptor), temporary.stat()):
                    return descriptor
        except OSError:
            os.close(descriptor)
            raise
        os.close(descriptor)


def _append(file: Path, data: bytes) -> None:
    """Write at the end and sync; cut off what was written when that fails."""
    is_new = not file.exists()
    descriptor = os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        size = os.fstat(descriptor).st_size
        try:
            _write_all(descriptor, data)
            os.fsync(descriptor)
        except OSError:
            with contextlib.suppress(OSError):  # the first error is the one to tell
                os.ftruncate(descriptor, size)
                if is_new and size == 0:
                    file.unlink()
            raise
        if is_new:
            _sync_folder(file.parent)
    finally:
        os.close(descriptor)


def _write_all(descriptor: int, data: bytes) -> None:
    """os.write may take only a part; the next call then says why."""
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest) :]


def _make_folder(folder: Path) -> None:
    """Make a folder and its parents, each durable."""
    if folder.is_dir():
        return
    _make_folder(folder.parent)
    with contextlib.suppress(FileExistsError):
        folder.mkdir()
    if not folder.is_dir():
        raise StorageError(f"{folder} is a file, but a folder is needed there; use another path or remove the file")
    _sync_folder(folder.parent)


def _sync_folder(folder: Path) -> None:
    """Make the names in a folder durable; a folder that is gone needs nothing."""
    with contextlib.suppress(FileNotFoundError):
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextlib.contextmanager
def _translated(act: str) -> Iterator[None]:
    """Turn an operating-system error of a change into the library's own."""
    try:
        yield
    except OSError as error:
        if error.errno in _FULL:
            raise StorageFull(
                f"cannot {act}: no space is left ({error.strerror}); free space or raise the quota, then run again: "
                "everything that was acknowledged before is safe"
            ) from error
        if error.errno in _READ_ONLY:
            raise StorageReadOnly(
                f"cannot {act}: {error.strerror}; make the directory writable for user {os.geteuid()}, "
                "or choose another storage address"
            ) from error
        if error.errno in {errno.EISDIR, errno.ENOTDIR, errno.ENAMETOOLONG}:
            raise StorageError(f"cannot {act}: {error.strerror}; use another path") from error
        raise _unavailable(error, act) from error


def _unavailable(error: OSError, act: str) -> StorageUnavailable:
    advice = "check its permissions" if error.errno in _READ_ONLY else "check the disk or mount, then try again"
    return StorageUnavailable(f"cannot {act}: {error.strerror or error}; {advice}")

"""From an address to the storage behind it."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import unquote, urlsplit

from fleet.errors import Problem, SpecError
from fleet.storage.limits import Limits
from fleet.storage.local import LocalStorage
from fleet.storage.port import Storage

_KNOWN = "write file:///absolute/folder or webhdfs://user@namenode:9870/folder"
PATIENCE = "FLEET_STORAGE_PATIENCE_S"


def open_storage(uri: str, limits: Limits | None = None) -> Storage:
    """The storage at an address: `file:///absolute/folder` or `webhdfs://[user@]namenode[:9870][,namenode2]/folder`.

    Args:
        limits: What one call may take.

    Raises:
        SpecError: the address is not one; says what to write instead.
    """
    address, limits = urlsplit(uri), limits or Limits()
    match address.scheme:
        case "file":
            return LocalStorage(_folder(uri), limits)
        case "webhdfs":
            return _hdfs(uri, limits)
        case "hdfs" | "swebhdfs":
            why = "is Hadoop's own protocol" if address.scheme == "hdfs" else "needs TLS, which is not spoken here"
            hint = f"write webhdfs://user@{address.hostname or 'namenode'}:9870/folder"
            raise _wrong(uri, f"begins with {address.scheme}://, which {why}", hint)
        case _ if "://" not in uri:
            raise _wrong(uri, "is a path, not an address", f"write {Path(uri).absolute().as_uri()}")
        case _:
            raise _wrong(uri, f"begins with {address.scheme}://, which is no known storage", _KNOWN)


def _hdfs(uri: str, limits: Limits) -> Storage:
    # Loading it takes as long as the rest of a small role's start, and most runs are in a local directory.
    from fleet.storage.hdfs import PATIENCE_S, HdfsStorage  # noqa: PLC0415
    from fleet.storage.webhdfs_address import WebHdfsAddress  # noqa: PLC0415

    patience = os.environ.get(PATIENCE, "")
    if patience and not patience.isdigit():
        raise SpecError([Problem(PATIENCE, f"{patience!r} is not a number of seconds")], source="the environment")
    return HdfsStorage(WebHdfsAddress.parse(uri), float(patience or PATIENCE_S), limits)


def _folder(uri: str) -> Path:
    address = urlsplit(uri)
    folder = Path(unquote(address.path))
    if not uri.startswith("file://") or address.netloc not in {"", "localhost"} or not folder.is_absolute():
        raise _wrong(uri, "names no absolute folder", "write file:/// and the absolute path: file:///var/lib/fleet")
    if address.query or address.fragment:
        raise _wrong(uri, "has a ? or # that is not part of a folder's address", "write ? as %3F and # as %23")
    return folder


def _wrong(uri: str, message: str, hint: str) -> SpecError:
    return SpecError([Problem("storage.uri", f"{uri!r} {message}", hint)])

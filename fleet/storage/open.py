"""From an address to the storage behind it."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import unquote, urlsplit

from fleet.errors import Problem, SpecError
from fleet.storage.local import LocalStorage
from fleet.storage.port import Storage


def open_storage(uri: str) -> Storage:
    """The storage at an address: `file:///absolute/folder`.

    Raises:
        SpecError: the address is not one; says what to write instead.
    """
    address = urlsplit(uri)
    if address.scheme == "file":
        return LocalStorage(_folder(uri))
    if "://" not in uri:
        raise _wrong(uri, "is a path, not an address", f"write {Path(uri).absolute().as_uri()}")
    raise _wrong(uri, f"begins with {address.scheme}://, which is no known storage", "write file:///absolute/folder")


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

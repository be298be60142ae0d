"""From a folder in storage to a context, whatever its kind, and from one storage to another."""

from __future__ import annotations

from fleet.contexts.base import Context, ContextKind
from fleet.contexts.cube import AutonomyCube
from fleet.contexts.files import join, place, read_cube, read_file
from fleet.contexts.manifest import MANIFEST, BrokenContext, kind_of
from fleet.errors import ContextError, ObjectNotFound
from fleet.storage.port import Storage


def load_context(storage: Storage, path: str = "") -> Context:
    """Open a context.

    Args:
        storage: Where it is; a local folder is `LocalStorage(folder)` with the path "".
        path: Its folder in the storage.

    Raises:
        BrokenContext: it is not a good context; has every problem at once.
        ContextError: it is of a kind that this version cannot fly.
        StorageError: the storage does not answer.
    """
    kind = kind_of(read_file(storage, path, MANIFEST), place(storage, path))
    match kind:
        case ContextKind.AUTONOMY_CUBE:
            return load_cube(storage, path)
        case ContextKind.VIDEO_STREAM | ContextKind.POINT_CLOUD:
            raise ContextError(
                f"{place(storage, path)}: contexts of kind {kind} are planned, but this version cannot fly them; "
                f"use kind: {ContextKind.AUTONOMY_CUBE}"
            )


def load_cube(storage: Storage, path: str = "") -> AutonomyCube:
    """Open an autonomy cube; see `load_context`."""
    content, _ = read_cube(storage, path)
    try:
        return AutonomyCube(content)
    except BrokenContext as error:
        raise BrokenContext(place(storage, path), list(error.problems)) from error


def copy_context(source: Storage, source_path: str, target: Storage, target_path: str) -> None:
    """Copy all files of a context; what is there already with the same content is not written again.

    context.yaml comes last, so that a half-copied context is not taken for one.

    Raises:
        BrokenContext: there is no context.yaml at the source.
        StorageError: a storage refuses.
    """
    manifest = read_file(source, source_path, MANIFEST)
    prefix = join(source_path, "")
    for entry in source.list(source_path):
        name = entry.path.removeprefix(prefix)
        if name != MANIFEST:
            _copy(source.read(entry.path), target, join(target_path, name))
    _copy(manifest, target, join(target_path, MANIFEST))


def _copy(data: bytes, target: Storage, path: str) -> None:
    try:
        if target.read(path) == data:
            return
    except ObjectNotFound:
        pass
    target.write(path, data)

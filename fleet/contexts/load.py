"""From a folder in storage to a context, whatever its kind, and from one storage to another."""

from __future__ import annotations

from fleet.contexts.base import Context, ContextKind
from fleet.contexts.cube import AutonomyCube
from fleet.contexts.files import join, place, read_cube, read_file
from fleet.contexts.manifest import MANIFEST, BrokenContext, kind_of
from fleet.contexts.tables import FEATURES, PICTURES
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
        raise BrokenContext(place(storage, path), error.problems) from error


def copy_context(source: Storage, source_path: str, target: Storage, target_path: str) -> None:
    """Copy the files of a good context; what is there already with the same content is not written again.

    context.yaml comes last, so that a half-copied context is not taken for one.

    Raises:
        BrokenContext: it is not a good context; nothing was written.
        ContextError: it is of a kind that this version cannot fly.
        StorageError: a storage refuses.
    """
    load_context(source, source_path)
    for name in (FEATURES, PICTURES, MANIFEST):
        path = join(source_path, name)
        if source.exists(path):
            _copy(source.read(path), target, join(target_path, name))


def _copy(data: bytes, target: Storage, path: str) -> None:
    try:
        if target.read(path) == data:
            return
    except ObjectNotFound:
        pass
    target.write(path, data)

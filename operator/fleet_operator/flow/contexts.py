"""Contexts on their way into a fleet's storage: copied once, and again only when they are other ones."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

from fleet.contexts.files import join
from fleet.contexts.load import copy_context
from fleet.contexts.manifest import MANIFEST
from fleet.contexts.tables import FEATURES, PICTURES
from fleet.errors import ContextError, ObjectNotFound, SpecError
from fleet.spec.functions import ContextSpec
from fleet.spec.resources import FleetSpec
from fleet.storage.layout import FleetPaths
from fleet.storage.local import LocalStorage
from fleet.storage.port import Storage

_FILES = (MANIFEST, FEATURES, PICTURES)


def copy_contexts(
    spec: FleetSpec, folder: Path, storage: Storage, paths: FleetPaths, opened: Callable[[str], Storage]
) -> None:
    """Copy every context of a FleetSpec into its storage, unless what is there came from the very same one.

    Args:
        folder: Where relative addresses start.
        opened: Opens the storage of a context that has an address.

    Raises:
        ContextError: one is not there, or is not a good one.
        StorageError: a storage refuses.
    """
    for context in spec.spec.contexts:
        source, digest = _source(context, folder, opened)
        mark = json.dumps({"uri": context.uri, "digest": digest}).encode()
        origin = paths.origin(context.name)
        known = _read(storage, origin)
        if known == mark:
            continue
        if known is not None:
            storage.delete(origin)  # what is there is no longer the old one, and not yet the new one
        copy_context(source, "", storage, paths.context(context.name))
        if not source.exists(PICTURES):
            storage.delete(join(paths.context(context.name), PICTURES))
        storage.write(origin, mark)


def _source(context: ContextSpec, folder: Path, opened: Callable[[str], Storage]) -> tuple[Storage, str]:
    """Where a context is, and what tells it from others: the content beside a FleetSpec, the sizes in a storage."""
    if "://" in context.uri:
        return _at_address(context, opened)
    place = folder / context.uri
    if not place.is_dir():
        raise ContextError(f"context {context.name}: there is no folder {context.uri} beside the FleetSpec")
    hasher = hashlib.blake2b(digest_size=16)
    for name in _FILES:
        file = place / name
        if file.is_file():
            data = file.read_bytes()
            hasher.update(f"{name} {len(data)}\n".encode() + data)
    return LocalStorage(place), hasher.hexdigest()


def _at_address(context: ContextSpec, opened: Callable[[str], Storage]) -> tuple[Storage, str]:
    try:
        storage = opened(context.uri)
    except SpecError as error:
        raise ContextError(f"context {context.name}: {error}") from error
    if not storage.exists(MANIFEST):
        raise ContextError(f"context {context.name}: there is no context at {context.uri}; correct its uri")
    sizes = [(entry.path, entry.size_bytes) for entry in storage.list("") if entry.path in _FILES]
    return storage, hashlib.blake2b(repr(sizes).encode(), digest_size=16).hexdigest()


def _read(storage: Storage, path: str) -> bytes | None:
    try:
        return storage.read(path)
    except ObjectNotFound:
        return None

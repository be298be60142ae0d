"""An autonomy cube as files: context.yaml, features.parquet and pictures.parquet in one folder of a storage."""

from __future__ import annotations

from fleet.contexts.cells import CubeContent
from fleet.contexts.manifest import MANIFEST, BrokenContext, CubeManifest, PictureKind, manifest_text, parse_manifest
from fleet.contexts.tables import (
    FEATURES,
    PICTURES,
    TableError,
    read_cells,
    read_pictures,
    write_cells,
    write_pictures,
)
from fleet.errors import ObjectNotFound, Problem
from fleet.storage.port import Storage

_DOUBLE = ("lat", "lon")
"""A float32 knows a place on Earth to a metre only."""


def join(folder: str, name: str) -> str:
    """Path of an object in a folder; the folder "" is the storage itself."""
    return f"{folder}/{name}" if folder else name


def place(storage: Storage, folder: str) -> str:
    """A context's address, for messages."""
    return join(storage.uri.rstrip("/"), folder) if folder else storage.uri


def read_manifest(storage: Storage, folder: str) -> CubeManifest:
    """context.yaml of an autonomy cube. Raises BrokenContext."""
    return parse_manifest(read_file(storage, folder, MANIFEST), place(storage, folder))


def read_cube(storage: Storage, folder: str) -> tuple[CubeContent, tuple[str, ...]]:
    """The content of an autonomy cube, not yet examined, and columns of its table that were not read.

    Raises:
        BrokenContext: a file is missing, broken or of a wrong type; has every problem at once.
        StorageError: the storage does not answer.
    """
    where = place(storage, folder)
    manifest = read_manifest(storage, folder)
    try:
        cells, unread = read_cells(read_file(storage, folder, FEATURES), manifest.feature_names)
        pictures = None
        if manifest.pictures is PictureKind.STORED and storage.exists(join(folder, PICTURES)):
            pictures = read_pictures(read_file(storage, folder, PICTURES))
    except TableError as error:
        raise BrokenContext(where, error.problems) from error
    return CubeContent(manifest, cells, pictures), unread


def write_cube(content: CubeContent, storage: Storage, folder: str = "") -> None:
    """Write an autonomy cube; context.yaml comes last, so that a half-written cube is not taken for one.

    Raises:
        StorageError: the storage refuses.
    """
    storage.write(join(folder, FEATURES), write_cells(content.cells, float64=_DOUBLE))
    if content.pictures is not None:
        storage.write(join(folder, PICTURES), write_pictures(content.pictures))
    storage.write(join(folder, MANIFEST), manifest_text(content.manifest))


def read_file(storage: Storage, folder: str, name: str) -> bytes:
    """One file of a context. Raises BrokenContext when it is missing."""
    try:
        return storage.read(join(folder, name))
    except ObjectNotFound as error:
        hint = "a context is a folder with context.yaml and features.parquet"
        raise BrokenContext(place(storage, folder), [Problem(name, "is missing", hint)]) from error

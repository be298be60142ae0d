"""From what a user names on the command line to typed values: the FleetSpec, its functions, its contexts."""

# ruff: noqa: PLC0415 - imports wait until a command runs, so that --help is quick

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fleet.cli import console
from fleet.errors import ContextError, Problem, SpecError

if TYPE_CHECKING:
    from fleet.learning.workbench import Workbench
    from fleet.spec.resources import FleetSpec
    from fleet.storage.layout import FleetPaths
    from fleet.storage.port import Storage


def read_spec(path: Path) -> FleetSpec:
    """The FleetSpec of a file; warnings go to stderr.

    Raises:
        SpecError: with every problem of the file.
    """
    from fleet.spec.check import examine

    examination = examine(path)
    if examination.spec is None or examination.problems:
        raise SpecError(list(examination.problems), source=str(path))
    for warning in examination.warnings:
        console.note(f"warning: {warning}")
    return examination.spec


def read_overrides(values: Sequence[str]) -> dict[str, Path]:
    """Folders of contexts by name, from `NAME=DIR`.

    Raises:
        SpecError: one is not of that form, or has no such folder.
    """
    overrides, problems = {}, []
    for value in values:
        name, _, folder = value.partition("=")
        if not name or not folder:
            hint = "write --context my-field=path/to/folder"
            problems.append(Problem("--context", f"{value!r} is not NAME=DIR", hint))
        elif not Path(folder).is_dir():
            problems.append(Problem("--context", f"there is no folder {folder}"))
        else:
            overrides[name] = Path(folder)
    if problems:
        raise SpecError(problems, source="the command line")
    return overrides


def as_uri(place: str) -> str:
    """A folder, or an address as it is, as the address of a storage."""
    return place if "://" in place else Path(place).absolute().as_uri()


def storage_uri(spec: FleetSpec, folder: Path, given: str | None = None) -> str:
    """Address of a run's storage: the one given on the command line, the FleetSpec's, or the run's own folder."""
    return given or spec.spec.storage.uri or as_uri(str(folder / "storage"))


def cache_uri(spec: Path) -> str:
    """A place of this user for what is worked out from a FleetSpec and can be worked out again."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    digest = hashlib.blake2b(str(spec.absolute()).encode(), digest_size=6).hexdigest()
    return (base / "fleet" / digest).absolute().as_uri()


def open_bench(
    spec: FleetSpec, file: Path, storage: Storage, overrides: Mapping[str, Path], advance: console.Advance | None = None
) -> Workbench:
    """A workbench over the contexts of a FleetSpec, copied into storage; its functions run in this process.

    Args:
        file: The FleetSpec's file; its functions and profiles are beside it.
        advance: Told while Map() runs over a context.

    Raises:
        ContextError: a context is not there, or not a good one.
        FunctionError: a function cannot be imported.
        SpecError: `--context` names a context that the FleetSpec has not.
    """
    from fleet.functions.clients import open_eval, open_map
    from fleet.learning.workbench import Workbench

    paths = paths_of(spec)
    copy_contexts(spec, file.parent, storage, overrides)
    sys.path.insert(0, str(file.parent.absolute()))
    map_client, eval_client = open_map(spec.spec.map), open_eval(spec.spec.eval)
    return Workbench(spec.spec, storage, paths, map_client, eval_client, advance, file.parent)


def copy_contexts(spec: FleetSpec, beside: Path, storage: Storage, overrides: Mapping[str, Path]) -> None:
    """Copy every context of a FleetSpec into storage; errors as in `open_bench`.

    Args:
        beside: The folder that relative addresses start from.
        overrides: Folders that replace the address of a context.
    """
    from fleet.contexts.load import copy_context
    from fleet.storage.local import LocalStorage
    from fleet.storage.open import open_storage

    known = [context.name for context in spec.spec.contexts]
    unknown = sorted(set(overrides) - set(known))
    if unknown:
        raise SpecError(
            [Problem("--context", f"there is no context {name!r}", f"it has {', '.join(known)}") for name in unknown],
            source="the command line",
        )
    for context in spec.spec.contexts:
        folder = overrides.get(context.name, beside / context.uri)
        if context.name not in overrides and "://" in context.uri:
            source = open_storage(context.uri)
        elif folder.is_dir():
            source = LocalStorage(folder)
        else:
            raise ContextError(f"context {context.name}: there is no folder {folder}; correct its uri in the FleetSpec")
        copy_context(source, "", storage, paths_of(spec).context(context.name))


def read_beside(spec: Path, address: str) -> bytes:
    """A file that a FleetSpec names: beside it, or at an address of storage.

    Raises:
        StorageError: there is none.
    """
    from fleet.storage.open import open_storage

    place = address if "://" in address else str((spec.parent / address).absolute())
    folder, _, name = place.rpartition("/")
    return open_storage(as_uri(folder)).read(name)


def paths_of(spec: FleetSpec) -> FleetPaths:
    """Where a fleet's objects are in storage."""
    from fleet.storage.layout import FleetPaths

    return FleetPaths(spec.metadata.namespace, spec.name)

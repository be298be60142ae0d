"""The run that a command is about: its storage and its fleet."""

# ruff: noqa: PLC0415 - imports wait until a command runs, so that --help is quick

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from fleet.cli import inputs
from fleet.errors import Problem, SpecError

if TYPE_CHECKING:
    from fleet.storage.layout import FleetPaths
    from fleet.storage.port import Storage

SPEC_NAME = "fleet.json"


def storage_of(folder: Path, given: str | None = None) -> Storage:
    """The storage of a run: the one given, its folder `storage`, where its run.json says, or the folder itself.

    Raises:
        SpecError: there is no such folder.
    """
    from fleet.storage.local import LocalStorage
    from fleet.storage.open import open_storage

    if given:
        return open_storage(inputs.as_uri(given))
    if not folder.is_dir():
        problem = Problem("DIR", f"there is no folder {folder}", "name the folder of a run")
        raise SpecError([problem], "the command line")
    if (folder / "storage").is_dir():
        return LocalStorage(folder / "storage")
    ledger = folder / "run.json"
    return open_storage(json.loads(ledger.read_bytes())["storageUri"]) if ledger.is_file() else LocalStorage(folder)


def fleet_in(storage: Storage, wanted: str | None) -> FleetPaths:
    """The fleet that is wanted, or the only one that the storage has.

    Raises:
        SpecError: there is none, or it is not clear which.
    """
    from fleet.storage.layout import FleetPaths

    found = sorted(
        tuple(entry.path.split("/")[:2])
        for entry in storage.list("")
        if entry.path.count("/") == 2 and entry.path.endswith(f"/{SPEC_NAME}")
    )
    names = ["/".join(parts) for parts in found]
    if wanted is not None and wanted in names:
        return FleetPaths(*wanted.split("/"))
    if wanted is None and len(found) == 1:
        return FleetPaths(*found[0])
    if not found:
        hint = "name the folder that fleet run wrote, or --storage"
        problem = Problem("DIR", f"there is no run in {storage.uri}", hint)
    else:
        message = f"there is no fleet {wanted}" if wanted else "the storage has several fleets"
        problem = Problem("--fleet", message, f"choose one of {', '.join(names)}")
    raise SpecError([problem], "the command line")

"""Volumes of pods: scratch, the user's functions, and the storage where it is a folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePosixPath
from typing import Any
from urllib.parse import unquote, urlsplit

from fleet.errors import Problem, SpecError
from fleet_operator.compiler.target import Target
from fleet_operator.resources import names

Manifest = dict[str, Any]


def volumes(target: Target, scratch: Sequence[str]) -> list[Manifest]:
    """Volumes of a pod of a fleet.

    Args:
        scratch: Names of its containers' scratch volumes.

    Raises:
        SpecError: the FleetSpec names a folder as its storage that no volume holds.
    """
    found: list[Manifest] = [{"name": name, "emptyDir": {}} for name in scratch]
    if target.bundle:
        source = {"name": names.functions(target.spec.name, target.bundle.digest), "items": target.bundle.items()}
        found.append({"name": names.FUNCTIONS_VOLUME, "configMap": source})
    if storage_folder(target):
        claim = {"claimName": target.settings.storage_claim}
        found.append({"name": names.STORAGE_VOLUME, "persistentVolumeClaim": claim})
    return found


def mounts(target: Target, container: str, functions: bool, storage: bool) -> list[Manifest]:
    """What a container sees of them: a scratch folder of its own, and what it needs of the others.

    Containers of one pod have one user: in a folder that they share, a user's image could put what others run.
    """
    found: list[Manifest] = [{"name": names.scratch_volume(container), "mountPath": names.SCRATCH_FOLDER}]
    if functions and target.bundle:
        found.append({"name": names.FUNCTIONS_VOLUME, "mountPath": names.FUNCTIONS_FOLDER, "readOnly": True})
    folder = storage_folder(target) if storage else ""
    if folder:
        found.append({"name": names.STORAGE_VOLUME, "mountPath": folder})
    return found


def storage_folder(target: Target) -> str:
    """Where the claim with the storage is mounted; "" when the storage is no folder, or there is no claim.

    Raises:
        SpecError: the FleetSpec names a folder that is not on the claim.
    """
    if not target.settings.storage_claim:
        return ""
    wanted, mounted = urlsplit(target.storage), urlsplit(target.settings.storage_uri)
    if wanted.scheme != "file":
        return ""
    folder = PurePosixPath(unquote(wanted.path))
    if ".." in folder.parts or not folder.is_relative_to(unquote(mounted.path)):
        hint = f"leave it out, or write a folder below file://{mounted.path}"
        raise SpecError([Problem("spec.storage.uri", f"no volume holds the folder {wanted.path}", hint)])
    return unquote(mounted.path)

"""Whose data is in storage, and what becomes of it when its FleetSpec is gone.

A finalizer could not be trusted with this: without an operator, it would keep the FleetSpec from being deleted. So
the claim is an object in the platform's storage, and the operator settles it whenever it finds the owner gone.
"""

from __future__ import annotations

from pydantic import Field, ValidationError

from fleet.errors import ObjectNotFound
from fleet.spec.base import Model
from fleet.spec.platform import DeletionPolicy
from fleet.storage.layout import CLAIMS, FleetPaths
from fleet.storage.port import Storage

LOCAL = "local"
"""The installation of an operator that shares its storage with no other."""


class Claim(Model):
    """A FleetSpec's claim to its folder."""

    namespace: str
    fleet: str
    uid: str = Field(description="Of the FleetSpec.")
    on_delete: DeletionPolicy
    uri: str = Field(description="Storage that has the folder.")
    root: str = Field(description="The folder.")
    installation: str = Field(
        default="",
        description="Of the operator that the FleetSpec belongs to: clusters may share a storage. Empty in early "
        "claims, of which only a FleetSpec with the same uid can say whose they are.",
    )

    @property
    def paths(self) -> FleetPaths:
        """Where the fleet's objects are."""
        return FleetPaths(self.namespace, self.fleet)


def read_claim(storage: Storage, paths: FleetPaths) -> Claim | None:
    """The claim to a fleet's folder; None when there is none. Raises StorageError."""
    try:
        claim = _parsed(storage.read(paths.claim))
    except ObjectNotFound:
        return None
    return claim if claim is not None and claim.paths == paths else None


def write_claim(storage: Storage, claim: Claim) -> None:
    """Make or replace a claim. Raises StorageError."""
    storage.write(claim.paths.claim, claim.model_dump_json(by_alias=True, indent=1).encode())


def all_claims(storage: Storage) -> tuple[Claim, ...]:
    """Every claim that is there. Raises StorageError."""
    found: list[Claim] = []
    for entry in storage.list(CLAIMS):
        try:
            claim = _parsed(storage.read(entry.path))
        except ObjectNotFound:
            continue
        if claim is not None and claim.paths.claim == entry.path:  # user code can write claims to others' data
            found.append(claim)
    return tuple(found)


def settle(claim: Claim, platform: Storage, data: Storage) -> None:
    """Do what a claim says is to be done when its owner is gone; the claim goes last, so that it may be done again.

    Raises:
        StorageError: a storage refuses.
    """
    if claim.on_delete is DeletionPolicy.DELETE:
        data.delete(claim.root)
    platform.delete(claim.paths.claim)


def _parsed(data: bytes) -> Claim | None:
    """None for what is no claim: it says nothing, and above all does not say that data may be deleted."""
    try:
        claim = Claim.model_validate_json(data)
    except ValidationError:
        return None
    return claim if claim.root == claim.paths.root else None

"""What one `fleet run` is about: the FleetSpec with the command line's changes, and where its run is."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fleet.cli import inputs
from fleet.errors import ObjectNotFound
from fleet.spec.resources import Fleet, FleetSpec
from fleet.storage.layout import FleetPaths
from fleet.storage.port import Entry, Storage
from fleet_operator.compiler.bundle import Bundle

_DIGITS = 16
_PATIENCE = {"resources", "timeout", "retries"}
_RENEWABLE: dict[str, Any] = {
    "map": _PATIENCE,
    "eval": _PATIENCE,
    "aggregation": {"resources"},
    "workflow": {"resources", "sensor_resources", "trainer_resources"},
    "missions": {"count", "interval", "schedule", "clock", "seed", "agent_retries"},
    "storage": True,
    "suspend": True,
}
"""What may change between two starts of one run: more missions, more memory for a program that was killed for want
of it. The seed is told apart from the rest."""


@dataclass(frozen=True)
class Application:
    """A fleet that is run here.

    Args:
        spec: The FleetSpec as it is flown.
        file: Where it was read from.
        out: Folder of the run.
        storage: Storage of the run.
        bundle: Function sources and other files beside the FleetSpec.
        overrides: Folders that replace the address of a context.
    """

    spec: FleetSpec
    file: Path
    out: Path
    storage: Storage
    bundle: Bundle = field(default_factory=Bundle)
    overrides: Mapping[str, Path] = field(default_factory=dict)

    @property
    def fleet(self) -> Fleet:
        """`spec` of the FleetSpec."""
        return self.spec.spec

    @property
    def paths(self) -> FleetPaths:
        """Where the fleet's objects are in storage."""
        return inputs.paths_of(self.spec)

    @property
    def agents(self) -> tuple[str, ...]:
        """Names of the agents."""
        return tuple(agent.name for agent in self.fleet.agents.resolved)

    def copy_contexts(self, target: Storage) -> None:
        """Copy all contexts from where they are into a storage.

        Raises:
            ContextError: one is not there.
            SpecError: an override names no context of the FleetSpec.
        """
        inputs.copy_contexts(self.spec, self.file.parent, target, self.overrides)

    def identity(self) -> dict[str, str]:
        """Hashes of everything that the results depend on, by what a user calls it."""
        digests = _Digests()
        self.copy_contexts(digests)
        contexts = {each.name: self.paths.context(each.name) for each in self.fleet.contexts}
        return {
            **spec_identity(self.spec),
            "the functions": self.bundle.digest[:_DIGITS],
            **{f"context {name}": digests.of_folder(path) for name, path in contexts.items()},
        }


def spec_identity(spec: FleetSpec) -> dict[str, str]:
    """Hashes of what the results depend on in a FleetSpec."""
    return {
        "the fleet's name": f"{spec.metadata.namespace}/{spec.name}",
        "the FleetSpec": _digest(spec.spec.model_dump_json(exclude=_RENEWABLE).encode()),
        "the seed": str(spec.spec.missions.seed),
    }


def with_changes(spec: FleetSpec, missions: int | None, seed: int | None) -> FleetSpec:
    """The FleetSpec with another number of missions and another seed, where these are given."""
    changes = {name: value for name, value in (("count", missions), ("seed", seed)) if value is not None}
    plan = spec.spec.missions.model_copy(update=changes)
    return spec.model_copy(update={"spec": spec.spec.model_copy(update={"missions": plan})})


class _Digests:
    """A storage that keeps only hashes: copying contexts into it tells their content."""

    uri = "memory:"

    def __init__(self) -> None:
        self._found: dict[str, str] = {}

    def of_folder(self, folder: str) -> str:
        """Hash of all that was written below a folder."""
        lines = [f"{path} {digest}" for path, digest in sorted(self._found.items()) if path.startswith(f"{folder}/")]
        return _digest("\n".join(lines).encode())

    def read(self, path: str) -> bytes:
        raise ObjectNotFound(path)

    def write(self, path: str, data: bytes) -> None:
        self._found[path] = _digest(data)

    def append(self, path: str, data: bytes) -> None:
        raise NotImplementedError

    def list(self, prefix: str) -> list[Entry]:
        return [Entry(path, 0) for path in self._found if path.startswith(prefix)]

    def exists(self, path: str) -> bool:
        return path in self._found

    def delete(self, prefix: str) -> None:
        raise NotImplementedError


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:_DIGITS]

"""A fleet under the reconciler, with a cluster in memory and a folder as storage; every call can be the last."""

from __future__ import annotations

import asyncio
import copy
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fleet.storage.layout import FleetPaths
from fleet.storage.local import LocalStorage
from fleet.storage.port import Entry, Storage
from fleet_operator.compiler.settings import Settings
from fleet_operator.flow.claims import all_claims
from fleet_operator.reconcile import FleetReconciler
from fleet_operator.reconcile.means import Means
from fleet_operator.resources.refs import FLEET_SPEC, Manifest, ObjectRef
from tests.fleet_runs import spec_document, write_application
from tests.memory_cluster import MemoryCluster

REF = ObjectRef("default", "plots")
PATHS = FleetPaths("default", "plots")
_CHANGING = {"uid", "resourceVersion", "creationTimestamp"}


@dataclass(frozen=True)
class WatchedStorage:
    """A folder as storage that tells each call before it is made.

    Args:
        before_call: Told the name of the call and its path; may raise.
        held: Bytes of each object by machine.
    """

    inner: LocalStorage
    before_call: Callable[[str], None]
    held: Mapping[str, Mapping[str, int]] = field(default_factory=dict)

    @property
    def uri(self) -> str:
        return self.inner.uri

    def read(self, path: str) -> bytes:
        self.before_call(f"read {path}")
        return self.inner.read(path)

    def write(self, path: str, data: bytes) -> None:
        self.before_call(f"write {path}")
        self.inner.write(path, data)

    def append(self, path: str, data: bytes) -> None:
        self.before_call(f"append {path}")
        self.inner.append(path, data)

    def list(self, prefix: str) -> list[Entry]:
        self.before_call(f"list {prefix}")
        return self.inner.list(prefix)

    def exists(self, path: str) -> bool:
        self.before_call(f"exists {path}")
        return self.inner.exists(path)

    def delete(self, prefix: str) -> None:
        self.before_call(f"delete {prefix}")
        self.inner.delete(prefix)

    def locations(self, prefix: str) -> Mapping[str, int]:
        return self.held.get(prefix, {})


@dataclass
class Reconciled:
    """One fleet, its cluster and its storage.

    Args:
        folder: Where everything is.

    Attributes:
        storage_calls: Calls of the reconciler to storage.
        before_storage: Called before each of them; may raise.
        held: Bytes of each object in storage by machine.
        later: What the last pass answered.
        opened: Opens storages for the next operator.
    """

    folder: Path
    cluster: MemoryCluster = field(default_factory=MemoryCluster)
    storage_calls: list[str] = field(default_factory=list)
    before_storage: Callable[[str], None] = lambda name: None
    held: dict[str, dict[str, int]] = field(default_factory=dict)
    later: float | None = None

    def __post_init__(self) -> None:
        self.opened: Callable[[str], Storage] = self._opened
        self.restart()

    @property
    def storage(self) -> LocalStorage:
        """The storage, not watched."""
        return LocalStorage(self.folder / "storage")

    def restart(
        self, namespaces: tuple[str, ...] = (), installation: str = "here", hosts: tuple[str, ...] = ()
    ) -> None:
        """A new operator, which remembers nothing."""
        settings, library = Settings(storage_uri=self.storage.uri, storage_hosts=hosts), self.folder / "library"
        clock, opened = self.cluster.clock, self.opened
        means = Means(self.cluster, settings, library, frozenset(namespaces), clock, opened, lambda: installation)
        self.reconciler = FleetReconciler(means)

    def ask(self, **changes: Any) -> None:
        """Have the user apply the FleetSpec with parts of its spec changed, and the files beside it."""
        if not (self.folder / "library" / REF.name).exists():
            write_application(self.folder / "library" / REF.name)
        document = spec_document(**changes)
        document["metadata"]["namespace"] = REF.namespace
        self.cluster.put(document)

    def has_data(self) -> bool:
        """Whether anything of the fleet is in storage."""
        return bool(self.storage.list(PATHS.root))

    def claims(self) -> list[str]:
        """Uids of the FleetSpecs that claim data."""
        return [claim.uid for claim in all_claims(self.storage)]

    def look(self) -> None:
        """One pass."""
        self.later = asyncio.run(self.reconciler.reconcile(REF))

    def settle(self, faults: Mapping[str, str] | None = None, until: str = "", passes: int = 60) -> list[str]:
        """Pass after pass, with Jobs that end in between, until nothing happens any more.

        Args:
            faults: As `MemoryCluster.run_jobs`.
            until: A phase at which to stop before the Jobs run; "" for none.

        Returns:
            The phases that the fleet went through.
        """
        phases: list[str] = []
        for _ in range(passes):
            self.look()
            if self.phase and self.phase not in phases[-1:]:
                phases.append(self.phase)
            if until and self.phase == until:
                return phases
            ended = self.cluster.run_jobs(faults)
            if not ended and self.later is None:
                return phases
            self.cluster.clock.sleep(0 if ended else self.later or 0)
        raise AssertionError(f"it never comes to rest: {phases}, {self.conditions()}")

    @property
    def body(self) -> Manifest:
        """The FleetSpec in the cluster."""
        body = self.cluster.fleet(REF)
        assert body is not None
        return body

    @property
    def status(self) -> dict[str, Any]:
        """Its status."""
        status: dict[str, Any] = self.body.get("status", {})
        return status

    @property
    def phase(self) -> str:
        """Its phase."""
        return str(self.status.get("phase", ""))

    def conditions(self) -> dict[str, tuple[str, str]]:
        """Status and reason of each condition."""
        return {each["type"]: (each["status"], each["reason"]) for each in self.status.get("conditions", ())}

    def message(self, condition: str) -> str:
        """What a condition says."""
        return next(str(each["message"]) for each in self.status["conditions"] if each["type"] == condition)

    def delete(self) -> Manifest:
        """Have the user delete the FleetSpec; what was deleted."""
        body = copy.deepcopy(self.body)
        self.cluster.remove(FLEET_SPEC, REF)
        return body

    def names(self, kind: str) -> list[str]:
        """Names of all objects of a kind."""
        return [ref.name for found, ref in sorted(self.cluster.objects) if found == kind]

    def picture(self) -> dict[str, Any]:
        """Everything that there is at the end, without what differs between two equal runs."""
        objects = {f"{kind} {ref}": _without_changing(body) for (kind, ref), body in self.cluster.objects.items()}
        stored = {entry.path: self.storage.read(entry.path) for entry in self.storage.list("")}
        return {"objects": objects, "storage": stored}

    def _opened(self, uri: str) -> Storage:
        def before(name: str) -> None:
            self.before_storage(name)
            self.storage_calls.append(name)

        folder = uri.removeprefix("file://")
        return WatchedStorage(LocalStorage(Path(folder)), before, self.held)


def _without_changing(body: Manifest) -> Manifest:
    copied: Manifest = json.loads(json.dumps(body))
    metadata = {name: value for name, value in copied["metadata"].items() if name not in _CHANGING}
    return copied | {"metadata": metadata}

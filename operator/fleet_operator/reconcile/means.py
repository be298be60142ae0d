"""What a pass works with."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from weakref import WeakValueDictionary

from fleet.clock import Clock, SystemClock
from fleet.storage.open import open_storage
from fleet.storage.port import Storage
from fleet_operator.cluster.port import Cluster
from fleet_operator.compiler.settings import Settings
from fleet_operator.flow.claims import LOCAL, Claim
from fleet_operator.flow.reach import Reach
from fleet_operator.reconcile.asked import Shelf
from fleet_operator.reconcile.seen import Seen
from fleet_operator.reconcile.storages import Storages
from fleet_operator.resources.refs import ObjectRef


@dataclass(frozen=True)
class Means:
    """What a pass works with.

    Args:
        cluster: The Kubernetes cluster.
        settings: What the installation decides.
        library: Folder with the files of fleets that bring none.
        namespaces: Where fleets are this operator's; none means everywhere.
        clock: Tells the time.
        opened: Opens a storage by its address.
        installation: Tells this installation from others that may share its storage.
    """

    cluster: Cluster
    settings: Settings = field(default_factory=Settings)
    library: Path = Path("/fleet/library")
    namespaces: frozenset[str] = frozenset()
    clock: Clock = field(default_factory=SystemClock)
    opened: Callable[[str], Storage] = open_storage
    installation: Callable[[], str] = lambda: LOCAL
    _locks: WeakValueDictionary[ObjectRef, asyncio.Lock] = field(
        default_factory=WeakValueDictionary, init=False, repr=False
    )

    @property
    def platform(self) -> Storage:
        """The platform's own storage. Raises SpecError when its address is none."""
        return self.storage(self.settings.storage_uri)

    def storage(self, uri: str) -> Storage:
        """The storage at an address, opened once.

        Raises:
            SpecError: it is no address, or not one that FleetSpecs may lead to.
        """
        self._reach.check(uri)
        return self._storages.at(uri)

    def visit(self, uri: str) -> Storage:
        """The storage at an address, for one look. Raises as `storage`."""
        self._reach.check(uri)
        return self.opened(uri)

    def is_ours(self, claim: Claim) -> bool:
        """Whether a claim says that it is of this installation."""
        return bool(claim.installation) and claim.installation == self.installation()

    def lock(self, ref: ObjectRef) -> asyncio.Lock:
        """Held by whoever settles or makes the claim of this fleet; two never do so at a time."""
        return self._locks.setdefault(ref, asyncio.Lock())

    def shelf(self, seen: Seen) -> Shelf:
        """Where the files beside a FleetSpec are."""
        return Shelf(seen.files, self.library)

    @cached_property
    def _storages(self) -> Storages:
        return Storages(self.opened)

    @cached_property
    def _reach(self) -> Reach:
        return Reach(self.settings.storage_uri, self.settings.storage_hosts)

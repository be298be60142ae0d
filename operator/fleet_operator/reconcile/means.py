"""What a pass works with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from fleet.clock import Clock, SystemClock
from fleet.storage.open import open_storage
from fleet.storage.port import Storage
from fleet_operator.cluster.port import Cluster
from fleet_operator.compiler.settings import Settings
from fleet_operator.reconcile.asked import Shelf
from fleet_operator.reconcile.seen import Seen


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
    """

    cluster: Cluster
    settings: Settings = field(default_factory=Settings)
    library: Path = Path("/fleet/library")
    namespaces: frozenset[str] = frozenset()
    clock: Clock = field(default_factory=SystemClock)
    opened: Callable[[str], Storage] = open_storage
    _storages: dict[str, Storage] = field(default_factory=dict, init=False, repr=False)

    @property
    def platform(self) -> Storage:
        """The platform's own storage. Raises SpecError when its address is none."""
        return self.storage(self.settings.storage_uri)

    def storage(self, uri: str) -> Storage:
        """The storage at an address, opened once.

        Raises:
            SpecError: it is no address.
        """
        if uri not in self._storages:
            self._storages[uri] = self.opened(uri)
        return self._storages[uri]

    def shelf(self, seen: Seen) -> Shelf:
        """Where the files beside a FleetSpec are."""
        return Shelf(seen.files, self.library)

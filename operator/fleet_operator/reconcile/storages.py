"""Storages that are open: each is opened once, and those that nobody used for long are forgotten."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from threading import Lock

from fleet.storage.port import Storage

MOST = 256
"""A FleetSpec may name a storage of its own; most fleets share the platform's."""


class Storages:
    """Storages by their addresses; may be used from any thread.

    Args:
        opened: Opens a storage by its address.
        most: How many are kept.
    """

    def __init__(self, opened: Callable[[str], Storage], most: int = MOST) -> None:
        self._opened = opened
        self._most = most
        self._kept: OrderedDict[str, Storage] = OrderedDict()
        self._lock = Lock()

    def at(self, uri: str) -> Storage:
        """The storage at an address.

        Raises:
            SpecError: it is no address.
        """
        with self._lock:
            storage = self._kept.get(uri) or self._opened(uri)
            self._kept[uri] = storage
            self._kept.move_to_end(uri)
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)
            return storage

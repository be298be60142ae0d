"""Loopback addresses for pods: Linux answers on all of 127.0.0.0/8, so every pod has ports of its own.

A run holds one or more prefixes 127.x.y.0/24. It owns a prefix as long as it listens on the prefix's first address;
another run that wants the same prefix fails to listen there and takes the next one.
"""

from __future__ import annotations

import contextlib
import socket
from collections import deque
from collections.abc import Sequence

from fleet.errors import FleetError

_PREFIXES = 250 * 256
_LOCK_PORT = 1025
_LOCK_HOST = 1
_HOSTS = range(2, 255)
_TRIES = 512


class AddressError(FleetError):
    """No loopback address is free."""


class Addresses:
    """Hands out loopback addresses, each to one pod at a time.

    Args:
        start: Where to look first; the process id, so that runs rarely meet.
    """

    def __init__(self, start: int) -> None:
        self._next_prefix = start
        self._locks: list[socket.socket] = []
        self._free: deque[str] = deque()

    def take(self) -> str:
        """An address that no pod of any run has.

        Raises:
            AddressError: none is free.
        """
        if not self._free:
            prefix = self._own_prefix()
            self._free.extend(f"{prefix}.{host}" for host in _HOSTS)
        return self._free.popleft()

    def give_back(self, address: str) -> None:
        """Let another pod have an address; the one that was free for longest is taken first."""
        self._free.append(address)

    def close(self) -> None:
        """Let other runs have the prefixes."""
        for lock in self._locks:
            lock.close()
        self._locks.clear()
        self._free.clear()

    def _own_prefix(self) -> str:
        for _ in range(_TRIES):
            number = self._next_prefix % _PREFIXES
            self._next_prefix += 1
            prefix = f"127.{number // 256 + 1}.{number % 256}"
            lock = _listen(f"{prefix}.{_LOCK_HOST}", _LOCK_PORT)
            if lock is not None:
                self._locks.append(lock)
                return prefix
        raise AddressError("no loopback address 127.x.y.z is free; end other runs of `fleet run`")


def free_ports(address: str, ports: Sequence[int]) -> bool:
    """Whether a pod could listen on all of these ports: false when another program has one on all addresses."""
    with contextlib.ExitStack() as stack:
        for port in ports:
            listener = _listen(address, port)
            if listener is None:
                return False
            stack.callback(listener.close)
    return True


def _listen(address: str, port: int) -> socket.socket | None:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((address, port))
        listener.listen(1)
    except OSError:
        listener.close()
        return None
    return listener

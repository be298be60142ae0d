"""TCP ports of the loopback address that no two users of the test bed choose at the same time."""

from __future__ import annotations

import random
import socket

# Below the range that the kernel takes ports for outgoing connections from (32768 up), so that a server can be
# stopped and started again on its port.
FIRST, LAST = 20000, 31999


class Ports:
    """Ports that are this process's until `close`: each is marked by an abstract Unix socket, which dies with us."""

    def __init__(self, seed: int | None = None) -> None:
        self._random = random.Random(seed)
        self._marks: list[socket.socket] = []

    def take(self) -> int:
        """A port that nobody listens on, and that no other `Ports` gives away."""
        for _ in range(1000):
            port = self._random.randint(FIRST, LAST)
            mark = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                mark.bind(f"\0fleet-testbed-port-{port}")
                _bindable(port)
            except OSError:
                mark.close()
                continue
            self._marks.append(mark)
            return port
        raise OSError("no free port was found")

    def close(self) -> None:
        """Give the ports back."""
        for mark in self._marks:
            mark.close()
        self._marks.clear()


def _bindable(port: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as servers do: TIME_WAIT is no hindrance
        probe.bind(("127.0.0.1", port))

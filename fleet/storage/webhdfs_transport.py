"""HTTP as data wants to be sent to DataNodes: only when the DataNode asks for it.

A request with `Expect: 100-continue` sends its body after the server's word. So a DataNode that hangs has nothing of it
that it could add to a file after it has woken up, when others have long done its work; and that is known at once.
Source: RFC 9110, section 10.1.1; Hadoop's DataNodes answer every CREATE and APPEND with 100 first.
"""

from __future__ import annotations

import socket
from typing import Any

from requests.adapters import HTTPAdapter
from urllib3.connection import HTTPConnection
from urllib3.connectionpool import HTTPConnectionPool
from urllib3.exceptions import NewConnectionError

ASKED_S = 5.0
"""How long a DataNode may take until it asks for the data."""
TAKEN_S = 30.0
"""How long a DataNode may take no data, or work on all of it: when it loses another one, it needs some seconds."""


class _AskedConnection(HTTPConnection):
    """A connection that waits for the server's word where a request has the header Expect."""

    _expects = False
    _refused = False

    def putrequest(self, *args: Any, **options: Any) -> None:
        self._expects = self._refused = False
        super().putrequest(*args, **options)

    def putheader(self, header: Any, *values: Any) -> None:
        self._expects |= header in {"Expect", b"Expect"}
        super().putheader(header, *values)

    def endheaders(self, *args: Any, **options: Any) -> None:
        super().endheaders(*args, **options)
        if self._expects and self.sock is not None:
            self._refused = not self._is_asked(self.sock)

    def send(self, data: Any) -> None:
        if not self._refused:
            super().send(data)

    def _is_asked(self, connection: socket.socket) -> bool:
        """Wait for the first line of an answer, which stays to be read.

        Raises:
            NewConnectionError: there is none, so that nothing was sent: the same as if there were no connection.
        """
        try:
            connection.settimeout(ASKED_S)
            line = connection.recv(len(b"HTTP/1.1 100"), socket.MSG_PEEK)
            connection.settimeout(TAKEN_S)
        except OSError as error:
            raise NewConnectionError(self, f"no answer before the data: {error}") from error
        if not line:
            raise NewConnectionError(self, "closed before the data")
        return line.endswith(b" 100")


class _AskedPool(HTTPConnectionPool):
    ConnectionCls = _AskedConnection


class AskedAdapter(HTTPAdapter):
    """Connections of a session that wait for the server's word before they send data."""

    def init_poolmanager(self, *args: Any, **options: Any) -> None:
        """As HTTPAdapter, with these connections."""
        super().init_poolmanager(*args, **options)
        self.poolmanager.pool_classes_by_scheme = {"http": _AskedPool}

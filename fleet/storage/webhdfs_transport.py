"""HTTP as WebHDFS wants it, and no more of it than is good for who asks.

A request with `Expect: 100-continue` sends its body after the server's word. So a DataNode that hangs has nothing of it
that it could add to a file after it has woken up, when others have long done its work; and that is known at once.
Source: RFC 9110, section 10.1.1; Hadoop's DataNodes answer every CREATE and APPEND with 100 first.

Answers may be anybody's, as users name the server. So each is read to its end before it is looked at, up to a size and
within a time, which no slow drop of data prolongs; and it leads nowhere but to another server of WebHDFS.
"""

from __future__ import annotations

import math
import socket
from typing import Any
from urllib.parse import urlsplit

import requests
from requests.adapters import HTTPAdapter
from urllib3.connection import HTTPConnection
from urllib3.connectionpool import HTTPConnectionPool
from urllib3.exceptions import HTTPError, NewConnectionError

from fleet.storage.limits import left_s, too_large

ASKED_S = 5.0
"""How long a DataNode may take until it asks for the data."""
TAKEN_S = 30.0
"""How long a DataNode may take no data, or work on all of it: when it loses another one, it needs some seconds."""
DOCUMENT_BYTES = 64 << 20
"""The largest answer that is no object: a folder with a hundred thousand files."""
_REDIRECTS = 3
_PREFIX = "/webhdfs/v1/"
_CHUNK_BYTES = 1 << 16


class TooLarge(requests.RequestException):
    """An answer is larger than what may be read."""


class Session(requests.Session):
    """A session that speaks HTTP to servers of WebHDFS, and to nobody else.

    Attributes:
        most_bytes: The largest answer that is read; set before each call.
    """

    def __init__(self) -> None:
        super().__init__()
        self.trust_env = False  # a proxy for the internet has nothing to do with HDFS
        self.max_redirects = _REDIRECTS
        self.headers["Accept-Encoding"] = "identity"
        self.adapters.clear()
        self._bounded = BoundedAdapter()
        self.mount("http://", self._bounded)

    @property
    def most_bytes(self) -> int:
        """The largest answer that is read."""
        return self._bounded.most_bytes

    @most_bytes.setter
    def most_bytes(self, most_bytes: int) -> None:
        self._bounded.most_bytes = most_bytes

    def get_redirect_target(self, resp: requests.Response) -> str | None:
        """Where an answer leads."""
        target = super().get_redirect_target(resp)
        return None if target is None else checked(target, resp.url)


def checked(target: str, asked: str) -> str:
    """The address that an answer leads to.

    Args:
        asked: The address that was asked.

    Raises:
        requests.exceptions.InvalidURL: it is none of WebHDFS.
    """
    parts = urlsplit(target)
    if parts.netloc and (parts.scheme not in ("", "http") or not parts.path.startswith(_PREFIX)):
        raise requests.exceptions.InvalidURL(f"{asked} leads to {target[:200]}, which is no address of WebHDFS")
    return target


class _TimedSocket(socket.socket):
    """A socket on which nothing goes on beyond the time of the call, however often a little arrives."""

    _step_s: float | None = None

    def settimeout(self, value: float | None) -> None:
        self._step_s = value
        super().settimeout(value)

    def recv(self, *args: Any) -> bytes:
        self._hurry()
        return super().recv(*args)

    def recv_into(self, *args: Any) -> int:
        self._hurry()
        return super().recv_into(*args)

    def sendall(self, *args: Any) -> None:
        self._hurry()  # of all the data together, which is what its time-out means
        super().sendall(*args)

    def _hurry(self) -> None:
        left = left_s()
        if left <= 0:
            raise TimeoutError("it takes too long altogether")
        super().settimeout(self._step_s if left == math.inf else min(left, self._step_s or left))


class _AskedConnection(HTTPConnection):
    """A connection that waits for the server's word where a request has the header Expect."""

    _expects = False
    _refused = False

    def _new_conn(self) -> socket.socket:
        plain = super()._new_conn()
        timed, timeout_s = _TimedSocket(fileno=plain.detach()), plain.gettimeout()
        timed.settimeout(timeout_s)
        return timed

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


class BoundedAdapter(HTTPAdapter):
    """Connections that wait for the server's word before they send data, and answers that are read here, up to a size.

    Attributes:
        most_bytes: The largest answer that is read.
    """

    most_bytes = DOCUMENT_BYTES

    def init_poolmanager(self, *args: Any, **options: Any) -> None:
        """As HTTPAdapter, with these connections."""
        super().init_poolmanager(*args, **options)
        self.poolmanager.pool_classes_by_scheme = {"http": _AskedPool}

    def send(self, request: requests.PreparedRequest, *args: Any, **options: Any) -> requests.Response:
        """As HTTPAdapter; the answer is all here when it returns.

        Raises:
            TooLarge: it is larger than what may be read.
        """
        response = super().send(request, *args, **{**options, "stream": True})
        try:
            response._content = self._body(response)
        except BaseException:
            response.raw.close()  # what is left of it is not waited for
            raise
        response._content_consumed = True  # as `Response.content` does
        response.close()
        return response

    def _body(self, response: requests.Response) -> bytes:
        said, found = response.headers.get("Content-Length", ""), bytearray()
        if said.isdecimal() and int(said) > self.most_bytes:
            raise TooLarge(too_large(int(said), self.most_bytes), request=response.request)
        try:
            for part in response.raw.stream(_CHUNK_BYTES, decode_content=False):
                found += part
                if len(found) > self.most_bytes:
                    raise TooLarge(too_large(0, self.most_bytes), request=response.request)
        except HTTPError as error:
            raise requests.ConnectionError(error, request=response.request) from error
        return bytes(found)

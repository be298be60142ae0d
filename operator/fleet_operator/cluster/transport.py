"""The one way to the API server: calls that are bounded, tried again with back-off, and answered with typed errors."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import random
import socket
import ssl
import weakref
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import aiohttp

from fleet_operator.cluster.credentials import Credentials
from fleet_operator.cluster.errors import ClusterError, NotLeading, Unauthorized, Unavailable
from fleet_operator.cluster.refusals import is_passing, refusal

APPLY = "application/apply-patch+yaml"
"""Server-side apply; JSON is YAML too."""
MERGE = "application/merge-patch+json"
STRATEGIC = "application/strategic-merge-patch+json"
JSON = "application/json"
HEADS = f"{JSON};as=PartialObjectMetadata;g=meta.k8s.io;v=v1"
LIST_OF_HEADS = f"{JSON};as=PartialObjectMetadataList;g=meta.k8s.io;v=v1"
"""Only the metadata of objects (Kubernetes, "API Concepts", Metadata-only fetches)."""

FIRST_PAUSE_S = 0.2
LONGEST_PAUSE_S = 8.0
CLOSING_S = 2.0
"""Longest wait for connections to end after the session; those that were being made end a moment later."""
_CLOSING_LOOK_S = 0.002
_FAULTS = (aiohttp.ClientError, TimeoutError, ssl.SSLError, OSError)
_METHODS = {"get": "GET", "list": "GET", "create": "POST", "update": "PUT", "patch": "PATCH", "delete": "DELETE"}


@dataclass(frozen=True)
class Call:
    """One call of the API; it must be one that can be sent twice.

    Args:
        verb: As RBAC has it: get, list, create, update, patch, delete.
        body: An object, or the JSON of one.
        content: Media type of the body.
        accept: Media type of the answer.
        tries: How often it is sent at most.
        urgent: It does not wait for a place among the calls in flight, and is not stopped by the fence.
    """

    verb: str
    path: str
    body: Mapping[str, Any] | bytes | None = None
    query: Mapping[str, str] = field(default_factory=dict)
    content: str = JSON
    accept: str = JSON
    tries: int = 5
    timeout_s: float = 30.0
    urgent: bool = False

    @property
    def writes(self) -> bool:
        """Whether it changes the cluster."""
        return self.verb not in ("get", "list")


@dataclass(frozen=True)
class Answer:
    """What the API server says to a call that it accepts."""

    status: int
    content: bytes

    @property
    def is_new(self) -> bool:
        """Whether the call made an object."""
        return self.status == 201

    def read(self) -> dict[str, Any]:
        """The object in it.

        Raises:
            Unavailable: it is none; a proxy may have answered.
        """
        try:
            body: dict[str, Any] = json.loads(self.content)
        except ValueError as error:
            raise Unavailable(f"an answer with HTTP {self.status} is not JSON: {self.content[:100]!r}") from error
        return body


class Transport:
    """Calls to one API server.

    Args:
        credentials: Where it is, and who calls.
        in_flight: Calls at the same time; the rest wait.
        left_s: Says for how many seconds this process may still write. A write is not begun when there are none, and
            given up when they are over: a late one could undo what another process has done by then.
        count: Told of each answer: verb, and HTTP status or 0.
        chance: Spreads the times of second tries.
    """

    def __init__(
        self,
        credentials: Credentials,
        in_flight: int = 32,
        left_s: Callable[[], float] = lambda: math.inf,
        count: Callable[[str, int], None] = lambda verb, status: None,
        chance: random.Random | None = None,
    ) -> None:
        self._credentials = credentials
        self._places = asyncio.Semaphore(in_flight)
        self._count = count
        self._chance = chance or random.Random()
        self._session: aiohttp.ClientSession | None = None
        self._sockets: weakref.WeakSet[socket.socket] = weakref.WeakSet()
        self.left_s = left_s

    async def __aenter__(self) -> Transport:
        # The API server would spend more on packing lists than the wire of a cluster takes to carry them.
        headers = {"Accept-Encoding": "identity", "User-Agent": "fleet-operator"}
        connector = aiohttp.TCPConnector(
            limit=0, ssl=self._credentials.tls, keepalive_timeout=60, socket_factory=self._socket
        )
        self._session = aiohttp.ClientSession(connector=connector, headers=headers, proxy=self._credentials.proxy)
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._session is not None:
            await self._session.close()
            self._session = None
            await self._end_connections()

    async def send(self, call: Call) -> dict[str, Any]:
        """The object that the API server answers with.

        Raises:
            ClusterError: it refused; what was passing was tried again.
        """
        return (await self.ask(call)).read()

    async def ask(self, call: Call) -> Answer:
        """The API server's answer.

        Raises:
            ClusterError: it refused; what was passing was tried again.
        """
        attempt, read_anew = 1, False
        while True:
            try:
                return await self._try(call)
            except Unauthorized:
                if read_anew:
                    raise
                read_anew = True
                self._credentials.reload()
            except ClusterError as error:
                if not is_passing(error) or attempt >= call.tries:
                    raise
                await asyncio.sleep(error.retry_after_s + self.pause_s(attempt))
                attempt += 1

    async def _try(self, call: Call) -> Answer:
        if call.urgent:
            return await self._exchange(call)
        async with self._places:
            left_s = self.left_s() if call.writes else math.inf
            if left_s <= 0.0:
                raise NotLeading(f"{call.verb} {call.path}: not sent, as another process may hold the lease by now")
            return await self._exchange(call, left_s)

    async def _exchange(self, call: Call, left_s: float = math.inf) -> Answer:
        headers = {**self._identity(), "Accept": call.accept}
        data = None
        if call.body is not None:
            headers["Content-Type"] = call.content
            data = call.body if isinstance(call.body, bytes) else json.dumps(call.body, separators=(",", ":")).encode()
        total_s = min(call.timeout_s, left_s)
        timeout = aiohttp.ClientTimeout(total=total_s, sock_connect=min(10.0, total_s))
        method, address = _METHODS[call.verb], self._credentials.server + call.path
        status = 0
        try:
            async with self._open.request(
                method, address, params=call.query, data=data, headers=headers, timeout=timeout
            ) as answer:
                status = answer.status
                content = await answer.read()
        except _FAULTS as error:
            status = 0
            raise Unavailable(f"{call.verb} {call.path}: {_said(error)}") from error
        finally:
            self._count(call.verb, status)
        if status >= 400:
            raise refusal(f"{call.verb} {call.path}", status, content, answer.headers.get("Retry-After", ""))
        return Answer(status, content)

    async def watch(
        self, path: str, query: Mapping[str, str], idle_s: float, accept: str = JSON
    ) -> AsyncIterator[list[bytes]]:
        """The lines of a watch as they come, some at a time; ends when the API server ends it.

        Args:
            accept: Media type of the objects.
            idle_s: Without a byte for so long the connection counts as dead.
        Raises:
            ClusterError: it was refused, or broke.
        """
        timeout = aiohttp.ClientTimeout(total=None, sock_connect=10.0, sock_read=idle_s)
        address, headers = self._credentials.server + path, {**self._identity(), "Accept": accept}
        status = 0
        try:
            async with self._open.get(address, params=query, headers=headers, timeout=timeout) as answer:
                status = answer.status
                if status >= 400:
                    raise refusal(f"watch {path}", status, await answer.read(), "")
                try:
                    async for lines in _lines(answer.content):
                        yield lines
                finally:
                    _hang_up(answer)
        except _FAULTS as error:
            raise Unavailable(f"watch {path}: {_said(error)}") from error
        finally:
            self._count("watch", status)
            if status == 401:
                self._credentials.reload()

    def pause_s(self, attempt: int) -> float:
        """How long to wait after a failed try (from 1): exponential with full jitter.

        Source: M. Brooker, "Exponential Backoff And Jitter", AWS Architecture Blog, 2015.
        """
        return self._chance.uniform(0.0, min(LONGEST_PAUSE_S, FIRST_PAUSE_S * 2.0**attempt))

    async def _end_connections(self) -> None:
        """Wait until nothing of the session outlives it: aiohttp does not for those that were being made or closed."""
        for each in list(self._sockets):
            with contextlib.suppress(OSError):  # it is closed, or was never open
                each.shutdown(socket.SHUT_RDWR)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(CLOSING_S):
                while any(each.fileno() >= 0 for each in self._sockets):
                    await asyncio.sleep(_CLOSING_LOOK_S)

    def _socket(self, address: tuple[Any, ...]) -> socket.socket:
        """A socket that is known here until it is closed.

        Args:
            address: Family, type and protocol, and what is not needed yet.
        """
        made = socket.socket(*address[:3])
        self._sockets.add(made)
        return made

    def _identity(self) -> dict[str, str]:
        token = self._credentials.token
        return {"Authorization": f"Bearer {token}"} if token else {}

    @property
    def _open(self) -> aiohttp.ClientSession:
        if self._session is None:
            raise Unavailable("the connection to the API server is not open")
        return self._session


async def _lines(content: aiohttp.StreamReader) -> AsyncIterator[list[bytes]]:
    """Whole lines; StreamReader's own readline refuses those of large objects."""
    rest = b""
    async for chunk in content.iter_any():
        *lines, rest = (rest + chunk).split(b"\n")
        if lines:
            yield lines


def _hang_up(answer: aiohttp.ClientResponse) -> None:
    """End a watch without TLS's long farewell, which would outlive the event loop."""
    connection = answer.connection
    if connection is not None and connection.transport is not None:
        connection.transport.abort()


def _said(error: BaseException) -> str:
    return str(error) or type(error).__name__

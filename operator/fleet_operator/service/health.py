"""The HTTP server that probes and Prometheus ask. It shares the event loop on purpose: a stuck loop answers nobody."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Mapping
from types import TracebackType

log = logging.getLogger(__name__)

LONGEST_REQUEST_S = 5.0
_PHRASES = {200: "OK", 404: "Not Found", 405: "Method Not Allowed", 503: "Service Unavailable"}


class HealthServer:
    """Serves texts by path.

    Args:
        port: 0 takes a free one.
        pages: By path, what makes the status code and text of the answer.
    """

    def __init__(self, port: int, pages: Mapping[str, Callable[[], tuple[int, str]]]) -> None:
        self._port = port
        self._pages = pages
        # All addresses of both families, unless the port is to be a free one: that would be another for each.
        self._host = None if port else "127.0.0.1"
        self._server: asyncio.Server | None = None

    async def __aenter__(self) -> HealthServer:
        self._server = await asyncio.start_server(self._serve, self._host, self._port)
        return self

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._server.sockets[0].getsockname()[1]) if self._server is not None else self._port

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError, TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            async with asyncio.timeout(LONGEST_REQUEST_S):
                head = await reader.readuntil(b"\r\n\r\n")
                writer.write(self._answer(head.split(b"\r\n", 1)[0].decode("latin-1")))
                await writer.drain()
        writer.close()

    def _answer(self, request: str) -> bytes:
        method, _, rest = request.partition(" ")
        page = self._pages.get(rest.partition(" ")[0].partition("?")[0])
        if method not in ("GET", "HEAD"):
            status, text = 405, "only GET\n"
        else:
            status, text = (404, "there is no such page\n") if page is None else page()
        body = text.encode()
        head = [f"HTTP/1.1 {status} {_PHRASES[status]}", "Content-Type: text/plain; charset=utf-8"]
        head += [f"Content-Length: {len(body)}", "Connection: close"]
        return "\r\n".join([*head, "", ""]).encode() + (b"" if method == "HEAD" else body)

"""A proxy in front of the API server or of WebHDFS: counts writes, calls a hook at one of them, injects faults.

    with Proxy(cluster.url, ca=cluster.ca) as proxy:
        kubeconfig = proxy.kubeconfig(folder, cluster.token)
        proxy.at_write(7, Moment.AFTER, lambda write: os.kill(pid, signal.SIGKILL))

It listens at a free port of the loopback address, by TLS when the server does, in a thread of its own. Watches pass
through unbuffered. Redirects of a NameNode are rewritten, so that data goes through the proxy too.
"""

from __future__ import annotations

import asyncio
import json
import random
import ssl
import threading
import time
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from urllib.parse import urlsplit

import aiohttp
from aiohttp import web

from tests.testbed.access import write_kubeconfig
from tests.testbed.certificates import Authority
from tests.testbed.faults import Fault, Moment, Write, is_write
from tests.testbed.ports import Ports

_VIA = "_via="
"""A parameter of the requests that a NameNode sends on: the DataNode. WebHDFS clients follow no other addresses."""
_OF_ONE_CONNECTION = {"connection", "keep-alive", "transfer-encoding", "content-length", "host", "upgrade"}
_START_S = 10.0


@dataclass
class _Hook:
    number: int
    moment: Moment
    call: Callable[[str], None]


@dataclass(eq=False)
class _Stream:
    """A watch that is open."""

    request: web.Request
    stalled: bool = False


@dataclass
class Proxy:
    """Passes requests on to one server.

    Args:
        upstream: `https://host:port` or `http://host:port`.
        ca: Whom to trust for https; its key is beside it, and signs the proxy's certificate.
        counts: Which writes get a number: (method, path with query). Renewals of leases do not, as they come by time,
            and neither does a request that only asks a NameNode where to write.
        seed: Of faults that come by chance.

    Attributes:
        writes: Those that got a number, in the order of their answers.
        requests: Everything that was asked: (method, path with query).
    """

    upstream: str
    ca: Path | None = None
    counts: Callable[[str, str], bool] = is_write
    seed: int = 0
    writes: list[Write] = field(default_factory=list)
    requests: list[tuple[str, str]] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)
    _number: int = 0
    _hook: _Hook | None = None
    _streams: set[_Stream] = field(default_factory=set)

    def __post_init__(self) -> None:
        self._chance = random.Random(self.seed)
        self._ports = Ports()
        self.port = self._ports.take()
        self._tls = None if self.ca is None else self._identity(self.ca)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name=f"proxy {self.port}", daemon=True)

    @property
    def url(self) -> str:
        return f"{'http' if self.ca is None else 'https'}://127.0.0.1:{self.port}"

    def kubeconfig(self, folder: Path, token: str, namespace: str = "default") -> Path:
        """A kubeconfig that leads through the proxy to an API server."""
        if self.ca is None:
            raise ValueError("an API server is reached by https: the proxy needs its ca")
        return write_kubeconfig(
            folder / f"proxy-{self.port}.kubeconfig", self.url, self.ca, {"token": token}, namespace
        )

    def __enter__(self) -> Proxy:
        self._thread.start()
        self._run(self._open())
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._run(self._close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
        self._ports.close()

    # -- what a test does with it

    def at_write(self, number: int, moment: Moment, call: Callable[[str], None]) -> None:
        """Call something with a write's method and path, and drop the request.

        Args:
            number: Of the write, counted from the last `start_counting`.
        """
        self._hook = _Hook(number, moment, call)

    def start_counting(self) -> None:
        """Forget the writes so far, and the hook."""
        self._number, self._hook = 0, None
        self.writes.clear()
        self.requests.clear()

    def down(self) -> None:
        """Refuse connections, and reset those that are open."""
        self._run(self._site.stop())
        self._run(self._abort_all())

    def up(self) -> None:
        """Take connections again."""
        self._run(self._listen())

    def cut_watches(self) -> int:
        """Reset the connections of all watches; how many there were."""
        streams = list(self._streams)
        self._run(_abort([each.request for each in streams]))
        return len(streams)

    def stall_watches(self) -> int:
        """Nothing more comes over the watches that are open now, and nothing says so; how many there were."""
        for stream in (streams := list(self._streams)):
            stream.stalled = True
        return len(streams)

    # -- the server

    def _run(self, work: Coroutine[None, None, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result(_START_S)

    async def _open(self) -> None:
        tls = ssl.create_default_context(cafile=str(self.ca)) if self.ca is not None else False
        connector = aiohttp.TCPConnector(ssl=tls, limit=0)
        self._client = aiohttp.ClientSession(
            connector=connector,
            auto_decompress=False,
            timeout=aiohttp.ClientTimeout(total=None, sock_connect=10),
            cookie_jar=aiohttp.DummyCookieJar(),
            skip_auto_headers=("User-Agent", "Accept", "Accept-Encoding", "Content-Type"),
        )
        application = web.Application(client_max_size=2**30)
        application.router.add_route("*", "/{path:.*}", self._handle)
        # A hook must not leave half an answer: handlers end with their client's connection.
        self._runner = web.AppRunner(application, handler_cancellation=True, shutdown_timeout=0.1)
        await self._runner.setup()
        await self._listen()

    def _identity(self, ca: Path) -> ssl.SSLContext:
        """The proxy's own certificate, of the authority that clients trust: clients send no token over plain HTTP."""
        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        context.load_cert_chain(*Authority(ca.parent).sign_server(f"proxy-{self.port}", ["127.0.0.1"], ["localhost"]))
        return context

    async def _listen(self) -> None:
        self._site = web.TCPSite(self._runner, "127.0.0.1", self.port, reuse_address=True, ssl_context=self._tls)
        await self._site.start()

    async def _close(self) -> None:
        await self._abort_all()
        await self._runner.cleanup()
        await self._client.close()

    async def _abort_all(self) -> None:
        server = self._runner.server
        for connection in server.connections if server is not None else ():
            if connection.transport is not None:
                connection.transport.abort()

    async def _handle(self, request: web.Request) -> web.StreamResponse:
        try:
            return await self._pass(request)
        except _Dropped:
            if request.transport is not None:
                request.transport.abort()
            raise asyncio.CancelledError from None
        except aiohttp.ClientError as error:
            return web.Response(status=502, text=f"the proxy cannot reach the server: {error}")

    async def _pass(self, request: web.Request) -> web.StreamResponse:
        path = request.raw_path
        self.requests.append((request.method, path))
        fault = next((each for each in self.faults if each.takes(request.method, path, self._chance)), None)
        if fault is not None:
            await asyncio.sleep(fault.delay_s)
            if fault.moment is Moment.BEFORE and fault.answers:
                return _answer(fault)
        body = await request.read()
        number = self._count(request.method, path)
        self._come(request, number, Moment.BEFORE)
        url = self._target(path)
        async with self._client.request(
            request.method, url, data=body or None, headers=_passed(request.headers), allow_redirects=False
        ) as got:
            if _is_watch(request):
                return await self._stream(request, got)
            content = await got.read()
        if number:
            self.writes.append(Write(request.method, path, body, got.status, time.time()))
        self._come(request, number, Moment.AFTER)
        if fault is not None and fault.answers:
            return _answer(fault)
        return self._answered(got, content)

    def _count(self, method: str, path: str) -> int:
        """The number of this write; 0 for what does not count."""
        if not self.counts(method, path):
            return 0
        self._number += 1
        return self._number

    def _come(self, request: web.Request, number: int, moment: Moment) -> None:
        """Call the hook when this is its write."""
        hook = self._hook
        if hook is not None and number and (hook.number, hook.moment) == (number, moment):
            self._hook = None
            hook.call(f"{request.method} {request.raw_path}")
            raise _Dropped

    def _target(self, path: str) -> str:
        path, _, datanode = path.partition(f"&{_VIA}")
        return f"http://{datanode}{path}" if datanode else self.upstream + path

    def _answered(self, got: aiohttp.ClientResponse, content: bytes) -> web.Response:
        """The server's answer, with the places that it names led through the proxy."""
        headers = _passed(got.headers)
        if "Location" in headers:
            headers["Location"] = self._through(headers["Location"])
        if b'"Location":"http' in content:
            place = json.loads(content)["Location"]
            content = json.dumps({"Location": self._through(place)}).encode()
        return web.Response(status=got.status, body=content, headers=headers)

    def _through(self, location: str) -> str:
        parts = urlsplit(location)
        if parts.scheme != "http" or parts.netloc == urlsplit(self.url).netloc:
            return location
        return f"{self.url}{parts.path}?{parts.query}&{_VIA}{parts.netloc}"

    async def _stream(self, request: web.Request, got: aiohttp.ClientResponse) -> web.StreamResponse:
        answer = web.StreamResponse(status=got.status, headers=_passed(got.headers))
        answer.enable_chunked_encoding()
        await answer.prepare(request)
        stream = _Stream(request)
        self._streams.add(stream)
        try:
            async for chunk in got.content.iter_any():
                if stream.stalled:
                    await asyncio.Event().wait()  # until the client goes
                await answer.write(chunk)
            await answer.write_eof()
        except (ConnectionResetError, aiohttp.ClientError):  # one of the two is gone, and so is the stream
            raise _Dropped from None
        finally:
            self._streams.discard(stream)
        return answer


class _Dropped(Exception):
    """The client gets no answer."""


def _is_watch(request: web.Request) -> bool:
    return request.method == "GET" and request.query.get("watch", "").lower() in {"1", "true"}


def _answer(fault: Fault) -> web.Response:
    if fault.reset:
        raise _Dropped
    return web.Response(
        status=fault.status, text=fault.body(), content_type="application/json", headers=fault.headers()
    )


def _passed(headers: Mapping[str, str]) -> dict[str, str]:
    """Headers without those that belong to one connection."""
    return {name: value for name, value in headers.items() if name.lower() not in _OF_ONE_CONNECTION}


async def _abort(requests: list[web.Request]) -> None:
    for request in requests:
        if request.transport is not None:
            request.transport.abort()

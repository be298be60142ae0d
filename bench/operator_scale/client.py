"""The floor: a client that knows nothing but how to send; and what else the benchmark asks of the API server."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import aiohttp

from fleet_operator.resources.refs import ObjectRef, kind_of
from tests.testbed.stand_in.api import read_kubeconfig

Manifest = dict[str, Any]
T = TypeVar("T")
IN_FLIGHT = 32
"""As the operator's own transport has it."""
APPLY = "application/apply-patch+yaml"
MERGE = "application/merge-patch+json"
_LARGEST_LINE = 1 << 23
_TRIES = 5
_PASSING = (429, 500, 503, 504)


class Client:
    """A session with one API server."""

    def __init__(self, kubeconfig: Path) -> None:
        self.server, self._headers, self._tls = read_kubeconfig(kubeconfig)
        self._session: aiohttp.ClientSession | None = None

    async def __aenter__(self) -> Client:
        connector = aiohttp.TCPConnector(limit=0, ssl=self._tls or False)
        timeout = aiohttp.ClientTimeout(total=None)
        headers = {**self._headers, "Accept-Encoding": "identity"}
        self._session = aiohttp.ClientSession(
            connector=connector, headers=headers, timeout=timeout, read_bufsize=_LARGEST_LINE
        )
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.session.close()

    @property
    def session(self) -> aiohttp.ClientSession:
        if self._session is None:
            raise RuntimeError("the client is used outside of its `async with`")
        return self._session

    async def call(
        self, method: str, path: str, body: Manifest | None = None, content: str = "application/json"
    ) -> Manifest:
        data = None if body is None else json.dumps(body).encode()
        headers = {"Content-Type": content}
        for attempt in range(_TRIES):
            async with self.session.request(method, self.server + path, data=data, headers=headers) as answer:
                text = await answer.read()
            if answer.status not in _PASSING:
                break
            await asyncio.sleep(0.2 * 2**attempt)
        if answer.status >= 400:
            raise RuntimeError(f"{method} {path}: {answer.status} {text[:500].decode(errors='replace')}")
        found: Manifest = json.loads(text)
        return found

    async def apply(self, manifest: Manifest) -> None:
        """Server-side apply, as the operator does it."""
        ref = ObjectRef.of(manifest)
        path = kind_of(manifest).path(ref.namespace, ref.name)
        await self.call("PATCH", f"{path}?fieldManager=floor&force=true", manifest, APPLY)

    async def apply_all(self, manifests: Sequence[Manifest]) -> float:
        """Apply objects; the seconds that it took."""
        return await self.for_each(manifests, self.apply)

    async def for_each(self, things: Sequence[T], act: Callable[[T], Awaitable[object]]) -> float:
        """Do something with all, as many at a time as the operator has calls in flight; the seconds that it took."""
        left = iter(things)

        async def worker() -> None:
            for thing in left:
                await act(thing)

        began = time.perf_counter()
        async with asyncio.TaskGroup() as tasks:
            for _ in range(IN_FLIGHT):
                tasks.create_task(worker())
        return time.perf_counter() - began

    async def watch(self, path: str, query: Mapping[str, str]) -> AsyncIterator[Manifest]:
        """Events from now on; it begins anew when the server ends it, and may then repeat what there is."""
        while True:
            listed = await self.call("GET", f"{path}?limit=1")
            version = listed["metadata"]["resourceVersion"]
            asked = {"watch": "1", "resourceVersion": version, "timeoutSeconds": "3600", **query}
            async with self.session.get(self.server + path, params=asked) as answer:
                async for line in answer.content:
                    yield json.loads(line)

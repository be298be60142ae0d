"""The API server as the stand-in sees it: calls, and listings that are kept up to date."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import ssl
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import aiohttp
import yaml

Manifest = dict[str, Any]
MERGE = "application/strategic-merge-patch+json"
_PATIENCE_S = 30.0
_PAUSE_S = 0.1
_TRY_AGAIN = {429, 500, 502, 503, 504}


class Refused(Exception):
    """The API server refused a call."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(f"{status}: {text[:500]}")
        self.status = status


AWAY = (aiohttp.ClientError, TimeoutError, Refused)
"""How a call ends when the server is away for longer than it is waited for, or says no."""


class Api:
    """Calls to the server of a kubeconfig; an API server that is away for a while is waited for."""

    def __init__(self, kubeconfig: Path) -> None:
        self.server, self._headers, self._tls = read_kubeconfig(kubeconfig)
        self._session: aiohttp.ClientSession | None = None

    async def __aenter__(self) -> Api:
        connector = aiohttp.TCPConnector(ssl=self._tls or False, limit=0)
        timeout = aiohttp.ClientTimeout(total=None, sock_connect=5)
        self._session = aiohttp.ClientSession(connector=connector, headers=self._headers, timeout=timeout)
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.session.close()

    @property
    def session(self) -> aiohttp.ClientSession:
        if self._session is None:
            raise RuntimeError("the Api is used outside of its `async with`")
        return self._session

    async def call(
        self, method: str, path: str, body: Manifest | None = None, content_type: str = "application/json"
    ) -> Manifest:
        """The answer to one request; tried again while the server is away.

        Raises:
            Refused: the server said no.
        """
        end = asyncio.get_running_loop().time() + _PATIENCE_S
        while True:
            try:
                return await self._once(method, path, body, content_type)
            except (aiohttp.ClientError, TimeoutError, Refused) as error:
                lasting = isinstance(error, Refused) and error.status not in _TRY_AGAIN
                if lasting or asyncio.get_running_loop().time() > end:
                    raise
            await asyncio.sleep(_PAUSE_S)

    async def _once(self, method: str, path: str, body: Manifest | None, content_type: str) -> Manifest:
        data = None if body is None else json.dumps(body).encode()
        timeout = aiohttp.ClientTimeout(total=15)
        headers = {"Content-Type": content_type}
        async with self.session.request(method, self.server + path, data=data, headers=headers, timeout=timeout) as got:
            text = await got.text()
        if got.status >= 400:
            raise Refused(got.status, text)
        found: Manifest = json.loads(text)
        return found


class Mirror:
    """All objects of one kind, kept up to date by a watch that is started anew whenever it ends."""

    def __init__(self, api: Api, path: str, changed: Callable[[], None]) -> None:
        self._api = api
        self._path = path
        self._changed = changed
        self.objects: dict[str, Manifest] = {}
        self.listed = asyncio.Event()

    async def run(self) -> None:
        while True:
            with contextlib.suppress(*AWAY, json.JSONDecodeError):
                version = await self._list()
                await self._watch(version)
            await asyncio.sleep(_PAUSE_S)

    async def _list(self) -> str:
        found = await self._api.call("GET", self._path)
        self.objects = {each["metadata"]["uid"]: each for each in found["items"]}
        self.listed.set()
        self._changed()
        version: str = found["metadata"]["resourceVersion"]
        return version

    async def _watch(self, version: str) -> None:
        query = f"?watch=1&allowWatchBookmarks=true&resourceVersion={version}"
        # A line may be long: one object with all that it carries.
        async with self._api.session.get(self._api.server + self._path + query, read_bufsize=2**22) as got:
            async for line in got.content:
                event = json.loads(line)
                if event["type"] == "ERROR":
                    return
                if event["type"] != "BOOKMARK":
                    self._take(event["type"], event["object"])

    def _take(self, kind: str, found: Manifest) -> None:
        if kind == "DELETED":
            self.objects.pop(found["metadata"]["uid"], None)
        else:
            self.objects[found["metadata"]["uid"]] = found
        self._changed()

    def __iter__(self) -> Iterator[Manifest]:
        return iter(list(self.objects.values()))


def read_kubeconfig(path: Path) -> tuple[str, dict[str, str], ssl.SSLContext | None]:
    """Server, headers and TLS of a kubeconfig's current context."""
    content = yaml.safe_load(path.read_text())
    chosen = next(each["context"] for each in content["contexts"] if each["name"] == content["current-context"])
    cluster = next(each["cluster"] for each in content["clusters"] if each["name"] == chosen["cluster"])
    user = next(each["user"] for each in content["users"] if each["name"] == chosen["user"])
    headers = {"Authorization": f"Bearer {user['token']}"} if "token" in user else {}
    if not cluster["server"].startswith("https"):
        return cluster["server"], headers, None
    data = cluster.get("certificate-authority-data")
    tls = ssl.create_default_context(
        cafile=cluster.get("certificate-authority"), cadata=base64.b64decode(data).decode() if data else None
    )
    if "client-certificate" in user:
        tls.load_cert_chain(user["client-certificate"], user["client-key"])
    return cluster["server"], headers, tls

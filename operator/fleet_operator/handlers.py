"""kopf tells what happens to custom resources, and nothing else.

kopf runs in a thread with an event loop of its own: it takes signals and cancels tasks of the loop that it runs in. Its
handlers pass events on. No finalizer, annotation, status or Event is ever written by it (docs/adr/0011).
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
from collections.abc import Iterator, Sequence
from typing import Any, TypeAlias

import kopf

from fleet_operator.cluster.credentials import Credentials
from fleet_operator.cluster.watches import Watches
from fleet_operator.resources.refs import FLEET_SPEC, MISSION, Kind

log = logging.getLogger(__name__)

PAUSES_S = (0.2, 0.5, 1.0, 2.0, 5.0)
FAREWELL_S = 0.25
"""Connections with TLS are closed after their session (aiohttp, Graceful shutdown)."""
STOP_S = 2.0
"""How long the end waits for kopf, which takes longer only when it has not begun to watch yet."""
Event: TypeAlias = Any  # kopf's RawEvent is not public


class KopfEnded(Exception):
    """kopf ended although nobody asked it to; the process must be started again."""


class KopfWatches:
    """Watches of custom resources.

    Args:
        namespaces: What is watched; none means all.
        watches: Told of each event, in the event loop that `run` is called in.
    """

    def __init__(self, credentials: Credentials, watches: Watches, namespaces: Sequence[str] = ()) -> None:
        self._credentials = credentials
        self._watches = watches
        self._namespaces = tuple(namespaces)
        self._stop = threading.Event()
        self._registry = kopf.OperatorRegistry()
        self._register()

    async def run(self) -> None:
        """Watch until cancelled.

        Raises:
            KopfEnded: kopf gave up.
        """
        # A kind that is not there when kopf begins is never watched; once it was listed it is there.
        await self._watches.synced()
        self._loop = asyncio.get_running_loop()
        ended: asyncio.Future[BaseException | None] = self._loop.create_future()
        thread = threading.Thread(target=self._thread, args=(ended,), name="kopf", daemon=True)
        thread.start()
        try:
            raise KopfEnded("kopf ended by itself") from await asyncio.shield(ended)
        finally:
            self._stop.set()
            await asyncio.to_thread(thread.join, STOP_S)

    def _register(self) -> None:
        registry = self._registry

        @kopf.on.login(registry=registry)
        def login(**_: Any) -> kopf.ConnectionInfo:
            self._credentials.reload()
            files = self._credentials.files
            return kopf.ConnectionInfo(
                server=self._credentials.server,
                ca_path=files.authority or None,
                insecure=not files.verify,
                certificate_path=files.certificate or None,
                private_key_path=files.key or None,
                scheme="Bearer",
                token=self._credentials.token or None,
                proxy_url=self._credentials.proxy,
            )

        @kopf.on.event(*_resource(FLEET_SPEC), registry=registry)
        async def fleet_spec(event: Event, **_: Any) -> None:
            self._pass_on(FLEET_SPEC, event)

        @kopf.on.event(*_resource(MISSION), registry=registry)
        async def mission(event: Event, **_: Any) -> None:
            self._pass_on(MISSION, event)

    def _pass_on(self, kind: Kind, event: Event) -> None:
        self._loop.call_soon_threadsafe(self._watches.news, kind, event["type"], dict(event["object"]))

    def _thread(self, ended: asyncio.Future[BaseException | None]) -> None:
        error: BaseException | None = None
        try:
            asyncio.run(self._operator())
        except Exception as raised:  # noqa: BLE001 - told to the loop that waits, which raises it
            error = raised
        with contextlib.suppress(RuntimeError):  # whoever waited has gone with its loop
            self._loop.call_soon_threadsafe(lambda: None if ended.done() else ended.set_result(error))

    async def _operator(self) -> None:
        await kopf.operator(
            registry=self._registry,
            settings=_settings(),
            standalone=True,
            clusterwide=not self._namespaces,
            namespaces=self._namespaces,
            stop_flag=self._stop,
        )
        await asyncio.sleep(FAREWELL_S)


def quiet() -> None:
    """Have kopf say only when a handler fails.

    It calls each try a failure, and misses the signals. What is wrong with the API server, the watches' own lists say.
    """
    logging.getLogger("kopf").setLevel(logging.CRITICAL)
    logging.getLogger("kopf.objects").setLevel(logging.ERROR)


class Patience:
    """Pauses between tries without an end: a watch is never given up."""

    def __iter__(self) -> Iterator[float]:
        yield from PAUSES_S
        while True:
            yield PAUSES_S[-1]


class NoDiffs(kopf.DiffBaseStorage):
    """Keeps nothing: no handler asks what changed, and building it is half of kopf's work for an event."""

    def build(self, **_: Any) -> kopf.BodyEssence:
        """Nothing."""
        return kopf.BodyEssence({})

    def fetch(self, **_: Any) -> None:
        """Nothing."""

    def store(self, **_: Any) -> None:
        """Nothing."""


def _settings() -> kopf.OperatorSettings:
    settings = kopf.OperatorSettings()
    settings.posting.enabled = False
    settings.scanning.disabled = True
    settings.persistence.diffbase_storage = NoDiffs()
    settings.networking.error_backoffs = Patience()
    settings.watching.chunk_size = 500
    settings.watching.reconnect_backoff = 0.2
    # kopf keeps a task for each object that was heard of so lately; with thousands of them it is its largest memory.
    settings.queueing.idle_timeout = 0.05
    return settings


def _resource(kind: Kind) -> tuple[str, str, str]:
    group, _, version = kind.api_version.partition("/")
    return group, version, kind.plural

"""All watches of the operator, and whether they can be trusted.

Built-in objects are followed by reflectors. News of custom resources comes from outside (kopf, in
fleet_operator.handlers); a list now and then, and after each list of kopf's, finds what kopf does not say.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import time
from collections.abc import Sequence
from functools import partial

from fleet_operator.cluster.errors import ClusterError
from fleet_operator.cluster.memory import Memory
from fleet_operator.cluster.reflector import Reflector, Scope, complain
from fleet_operator.cluster.shelves import FILES, FLEETS, JOBS, MADE, MISSIONS, NODES, Shelf
from fleet_operator.cluster.transport import Transport
from fleet_operator.resources.refs import Kind, Manifest

VERIFY_S = 300.0
"""Time between two lists of custom resources."""
SETTLE_S = 1.0
STALLED_S = 400.0
"""A watch that has neither heard nor tried anything for so long hangs; longer than VERIFY_S, and than a watch idles."""
_CUSTOM: dict[Kind, Shelf] = {shelf.kind: shelf for shelf in (FLEETS, MISSIONS)}


class Watches:
    """Everything that feeds the memory.

    Args:
        namespaces: What is watched; none means all.
    """

    def __init__(self, transport: Transport, memory: Memory, namespaces: Sequence[str] = ()) -> None:
        self._transport = transport
        self._memory = memory
        self._seen_s: dict[Scope, float] = {}
        self._waiting: set[Scope] = set()
        self._chance = random.Random()
        self._synced = asyncio.Event()
        self._doubts = {FLEETS: asyncio.Event(), MISSIONS: asyncio.Event()}
        everywhere = tuple(namespaces) or ("",)
        self._custom = [self._reflector(Scope(shelf, namespace)) for shelf in self._doubts for namespace in everywhere]
        built_in = [Scope(shelf, namespace) for shelf in (JOBS, FILES, *MADE) for namespace in everywhere]
        built_in.append(Scope(NODES))
        self._built_in = [self._reflector(scope) for scope in built_in]

    async def run(self) -> None:
        """Watch until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            for reflector in self._built_in:
                tasks.create_task(reflector.run(partial(self._listed, reflector.scope), self._doubt))
            for reflector in self._custom:
                tasks.create_task(self._verify(reflector))

    async def synced(self) -> None:
        """Wait until the memory has everything."""
        await self._synced.wait()

    @property
    def is_synced(self) -> bool:
        """Whether the memory has everything."""
        return self._synced.is_set()

    def stalled(self) -> str:
        """Which watch hangs; "" when none does."""
        now_s = time.monotonic()
        return next((str(scope) for scope, seen_s in self._seen_s.items() if now_s - seen_s > STALLED_S), "")

    async def refresh_fleets(self) -> None:
        """List the FleetSpecs now; tried until the API server answers."""
        for reflector in self._custom:
            if reflector.scope.shelf == FLEETS:
                await self._resync(reflector)

    def news(self, kind: Kind, event: str | None, body: Manifest) -> None:
        """Take an event of a custom resource.

        Args:
            event: ADDED, MODIFIED or DELETED; None when it is from a list. A list says that a watch was broken, and
                what was deleted meanwhile is in no event.
        """
        shelf = _CUSTOM[kind]
        if event == "DELETED":
            self._memory.drop(shelf, body)
            return
        self._memory.put(shelf, body)
        if event is None:
            self._doubts[shelf].set()

    async def _verify(self, reflector: Reflector) -> None:
        doubt = self._doubts[reflector.scope.shelf]
        while True:
            await self._resync(reflector)
            self._listed(reflector.scope)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(doubt.wait(), VERIFY_S * self._chance.uniform(0.8, 1.0))
            await asyncio.sleep(SETTLE_S)  # a list of kopf's comes as one event for each object
            doubt.clear()

    async def _resync(self, reflector: Reflector) -> None:
        failures = 0
        while True:
            try:
                await reflector.resync()
            except ClusterError as error:
                failures += 1
                complain(error, failures)
                self._alive(reflector.scope)
                await asyncio.sleep(self._transport.pause_s(failures))
            else:
                return

    def _doubt(self) -> None:
        for doubt in self._doubts.values():
            doubt.set()

    def _reflector(self, scope: Scope) -> Reflector:
        self._waiting.add(scope)
        self._alive(scope)
        return Reflector(self._transport, self._memory, scope, partial(self._alive, scope))

    def _alive(self, scope: Scope) -> None:
        self._seen_s[scope] = time.monotonic()

    def _listed(self, scope: Scope) -> None:
        self._waiting.discard(scope)
        if not self._waiting:
            self._synced.set()

"""One watch of built-in objects: list, then follow; list again when the place in history is lost.

kopf's watches do the same for custom resources. They are not used here because they cost four times as much for each
event, and because they do not say which objects vanished while a watch was broken (docs/adr/0011).

Source: Kubernetes, "API Concepts", Efficient detection of changes; Watch bookmarks.
"""

from __future__ import annotations

import asyncio
import json
import logging
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from fleet_operator.cluster.errors import ClusterError, Forbidden, Gone, Unavailable
from fleet_operator.cluster.glance import head_of_event
from fleet_operator.cluster.memory import Memory
from fleet_operator.cluster.shelves import Shelf
from fleet_operator.cluster.transport import HEADS, JSON, LIST_OF_HEADS, Call, Transport
from fleet_operator.resources.refs import ObjectRef

log = logging.getLogger(__name__)

IDLE_S = 100.0
"""Bookmarks come once a minute: a watch without a byte for so long is dead."""
LONGEST_WATCH_S = 300
TRIES_BEFORE_LIST = 3


def complain(error: ClusterError, failures: int) -> None:
    """Log a failure: one that lasts is worth a warning, but not for each of its tries."""
    lasts = failures == TRIES_BEFORE_LIST or failures % 20 == 0
    log.log(logging.WARNING if lasts else logging.INFO, "%s", error)


@dataclass(frozen=True)
class Scope:
    """What one watch follows: a shelf, in one namespace or in all."""

    shelf: Shelf
    namespace: str = ""

    def __str__(self) -> str:
        return f"{self.shelf.kind.plural} in {self.namespace or 'all namespaces'}"


class Reflector:
    """Keeps the memory of one scope right.

    Args:
        alive: Told each time that the API server gave a sign of life.
    """

    def __init__(self, transport: Transport, memory: Memory, scope: Scope, alive: Callable[[], None]) -> None:
        self.scope = scope
        self._transport = transport
        self._memory = memory
        self._alive = alive
        self._chance = random.Random()
        self._version = ""
        self._query = {"labelSelector": scope.shelf.label} if scope.shelf.label else {}

    async def resync(self) -> None:
        """Bring the memory to what the cluster has now; a watch goes on from there.

        Raises:
            ClusterError: the API server refuses.
        """
        shelf, namespace = self.scope.shelf, self.scope.namespace
        store = self._memory.store(shelf)
        newest = store.newest
        query = {**self._query, "limit": str(shelf.page)}
        accept = LIST_OF_HEADS if shelf.heads else JSON
        refs: list[ObjectRef] = []
        while True:
            page = await self._transport.send(Call("list", shelf.kind.path(namespace), query=query, accept=accept))
            version = int(page["metadata"]["resourceVersion"])
            if "continue" not in query and version < newest:
                log.warning("the history of %s was put back: what was seen of it is forgotten", self.scope)
                store.put_back(version, namespace)
            refs += self._take(page)
            self._alive()
            query["continue"] = page["metadata"].get("continue", "")
            if not query["continue"]:
                break
            await asyncio.sleep(0)  # a long list must not hold up everybody else
        self._memory.replace(shelf, refs, version, namespace)
        self._version = str(version)

    def _take(self, page: dict[str, Any]) -> list[ObjectRef]:
        shelf, refs = self.scope.shelf, []
        for body in page.get("items") or ():
            body.setdefault("apiVersion", shelf.kind.api_version)
            body.setdefault("kind", shelf.kind.kind)
            self._memory.put(shelf, body)
            refs.append(ObjectRef.of(body))
        return refs

    async def run(self, listed: Callable[[], None], lost: Callable[[], None]) -> None:
        """List and watch until cancelled.

        Args:
            listed: Told when the memory is right for the first time, or the scope was found to be forbidden.
            lost: Told when it had to list again: other watches may have lost their place in history, too, and one whose
                last object was deleted meanwhile says nothing of that.
        """
        failures, known = 0, False
        while True:
            try:
                if not self._version:
                    await self.resync()
                    listed()
                    if known:
                        lost()
                    known = True
                await self._watch()
                failures = 0
            except Gone:
                log.info("%s: the place in history is lost, listing again", self.scope)
                self._version = ""
            except ClusterError as error:
                failures += 1
                self._failed(error, failures, listed)
            self._alive()
            await asyncio.sleep(self._transport.pause_s(failures))

    def _failed(self, error: ClusterError, failures: int, listed: Callable[[], None]) -> None:
        if isinstance(error, Forbidden) and self.scope.shelf.optional:
            listed()
        if failures % TRIES_BEFORE_LIST == 0:  # a watch that cannot go on from its place is as bad as a lost one
            self._version = ""
        complain(error, failures)

    async def _watch(self) -> None:
        """Follow until the API server ends the watch."""
        longest_s = self._chance.randint(LONGEST_WATCH_S * 2 // 3, LONGEST_WATCH_S)
        query = {
            **self._query,
            "watch": "1",
            "allowWatchBookmarks": "true",
            "resourceVersion": self._version,
            "timeoutSeconds": str(longest_s),
        }
        path = self.scope.shelf.kind.path(self.scope.namespace)
        accept = HEADS if self.scope.shelf.heads else JSON
        async for lines in self._transport.watch(path, query, IDLE_S, accept):
            self._alive()
            for line in lines:
                self._event(line)

    def _event(self, line: bytes) -> None:
        head = head_of_event(line)
        if head is not None and self._memory.has(self.scope.shelf, head.ref, int(head.version)):
            self._version = head.version
            return
        event = json.loads(line)
        body = event["object"]
        if event["type"] == "ERROR":
            message = f"watch {self.scope}: {body.get('message', body)}"
            raise Gone(message) if body.get("code") == 410 else Unavailable(message, body.get("reason", ""))
        if event["type"] == "DELETED":
            self._memory.drop(self.scope.shelf, body)
        elif event["type"] != "BOOKMARK":
            self._memory.put(self.scope.shelf, body)
        self._version = body["metadata"]["resourceVersion"]

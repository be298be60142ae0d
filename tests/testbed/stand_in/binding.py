"""Carries out what the scheduler has planned."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

from tests.testbed.stand_in import scheduler
from tests.testbed.stand_in.api import MERGE, Api, Refused

Manifest = dict[str, Any]
Spawn = Callable[[Coroutine[None, None, None]], object]


class Binder:
    """Binds pods, and says of the others why they wait.

    Args:
        spawn: Runs a call beside all else.
    """

    def __init__(self, api: Api, spawn: Spawn) -> None:
        self._api = api
        self._spawn = spawn
        self._binding: set[str] = set()
        self._said: dict[str, str] = {}

    def schedule(self, pods: Sequence[Manifest], nodes: Sequence[Manifest]) -> None:
        """Bind what fits now."""
        found = scheduler.plan(pods, nodes)
        self._said = {uid: why for uid, why in self._said.items() if uid in found.waiting}
        for pod in pods:
            uid = pod["metadata"]["uid"]
            if uid in found.bindings and uid not in self._binding:
                self._binding.add(uid)
                self._spawn(self._bind(pod, found.bindings[uid]))
            if uid in found.waiting and self._said.get(uid) != found.waiting[uid]:
                self._said[uid] = found.waiting[uid]
                self._spawn(self._say_unschedulable(pod, found.waiting[uid]))

    async def _bind(self, pod: Manifest, node: str) -> None:
        metadata = {key: pod["metadata"][key] for key in ("name", "namespace", "uid")}
        target = {"apiVersion": "v1", "kind": "Node", "name": node}
        binding = {"apiVersion": "v1", "kind": "Binding", "metadata": metadata, "target": target}
        with contextlib.suppress(Refused):
            await self._api.call("POST", f"{path_of(pod)}/binding", binding)
        self._binding.discard(metadata["uid"])

    async def _say_unschedulable(self, pod: Manifest, message: str) -> None:
        condition = {"type": "PodScheduled", "status": "False", "reason": "Unschedulable", "message": message}
        with contextlib.suppress(Refused):
            await self._api.call("PATCH", f"{path_of(pod)}/status", {"status": {"conditions": [condition]}}, MERGE)


def path_of(pod: Manifest) -> str:
    """Address of a pod in the REST API."""
    return f"/api/v1/namespaces/{pod['metadata']['namespace']}/pods/{pod['metadata']['name']}"

"""What the kubelet remembers of a pod."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from fleet_operator.local.environment import Place
from tests.testbed.stand_in.pods import RunningPod
from tests.testbed.stand_in.statuses import View

Manifest = dict[str, Any]


@dataclass
class Entry:
    """A pod that is bound to one of the nodes.

    Args:
        number: Of the pod; 0 for one that ran before this stand-in, and only waits to be removed.
        gone: It is no longer in the API server.
    """

    manifest: Manifest
    number: int
    place: Place | None = None
    running: RunningPod | None = None
    view: View = field(default_factory=View)
    reported: View | None = None
    started: str = ""
    call: asyncio.Task[None] | None = None
    preparing: bool = False
    gone: bool = False

    @property
    def uid(self) -> str:
        return str(self.manifest["metadata"]["uid"])

    @property
    def node(self) -> str:
        return str(self.manifest["spec"]["nodeName"])

    @property
    def leaving(self) -> bool:
        return self.gone or "deletionTimestamp" in self.manifest["metadata"]

    @property
    def has_ended(self) -> bool:
        return self.running is None or self.running.stopped


def with_replaced(pod: Manifest, texts: Mapping[str, str]) -> Manifest:
    """The pod with other texts in the values of its variables."""
    changed: Manifest = json.loads(json.dumps(pod))
    for container in (*changed["spec"].get("initContainers", ()), *changed["spec"]["containers"]):
        for variable in container.get("env", ()):
            for old, new in texts.items():
                if "value" in variable:
                    variable["value"] = variable["value"].replace(old, new)
    return changed

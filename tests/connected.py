"""The operator's connection to a real API server, with its watches, for tests."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any, TypeVar

from fleet_operator import handlers
from fleet_operator.cluster.connection import Connection, connect
from fleet_operator.cluster.credentials import Credentials
from fleet_operator.resources.refs import Manifest, ObjectRef
from tests.conftest import ROOT
from tests.testbed.control_plane import ControlPlane

T = TypeVar("T")
PATIENCE_S = 60.0


def run(scenario: Callable[[], Awaitable[T]]) -> T:
    """What comes of a scenario; an error when it hangs."""

    async def limited() -> T:
        return await asyncio.wait_for(scenario(), 3 * PATIENCE_S)

    return asyncio.run(limited())


async def until(look: Callable[[], T]) -> T:
    """What `look` finds as soon as it finds something."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            found = look()
            if found:
                return found
            await asyncio.sleep(0.02)


@contextlib.asynccontextmanager
async def connected(
    kubeconfig: Path,
    namespace: str,
    count: Callable[[str, int], None] = lambda verb, status: None,
    kopf: bool = False,
) -> AsyncIterator[Connection]:
    """A connection whose memory follows a namespace; without kopf, changes of fleets are seen by lists only.

    kopf takes seconds to stop when it has not heard of anything yet.
    """
    credentials = Credentials({"KUBECONFIG": str(kubeconfig)})
    handlers.quiet()
    connection = connect(credentials, ObjectRef(namespace, "lease"), (namespace,), count)
    async with connection.transport:
        tasks = [asyncio.create_task(connection.watches.run())]
        if kopf:
            watches = handlers.KopfWatches(credentials, connection.watches, (namespace,))
            tasks.append(asyncio.create_task(watches.run()))
        try:
            async with asyncio.timeout(PATIENCE_S):
                await connection.watches.synced()
            yield connection
        finally:
            for task in tasks:
                task.cancel()
            for ended in await asyncio.gather(*tasks, return_exceptions=True):
                if isinstance(ended, Exception):
                    raise ended


def make_namespace(plane: ControlPlane, name: str) -> None:
    """A namespace on an API server that knows the custom resources."""
    for crd in ("fleetspecs", "missions"):
        plane.kubectl("apply", "--server-side", "--force-conflicts", "-f", str(ROOT / "crds" / f"{crd}.yaml"))
    plane.kubectl("wait", "--for=condition=Established", "crd", "--all")
    plane.kubectl("create", "namespace", name)


def config_map(namespace: str, name: str, **data: str) -> Manifest:
    """Functions of the fleet `crop`."""
    return {
        "apiVersion": "v1",
        "kind": "ConfigMap",
        "metadata": {"name": name, "namespace": namespace, "labels": {"fleetcomputer.io/fleet": "crop"}},
        "data": data,
    }


def job(namespace: str, name: str, fleet: str, suspend: bool = True, **labels: Any) -> Manifest:
    """A Job of a fleet that does nothing."""
    container = {"name": "main", "image": "none", "command": ["true"]}
    return {
        "apiVersion": "batch/v1",
        "kind": "Job",
        "metadata": {
            "name": name,
            "namespace": namespace,
            "labels": {"fleetcomputer.io/fleet": fleet, "fleetcomputer.io/role": "Trainer", **labels},
        },
        "spec": {
            "suspend": suspend,
            "template": {"spec": {"restartPolicy": "Never", "containers": [container]}},
        },
    }

"""The operator's process around a reconciler that does little: one ConfigMap for each fleet, and a line for each call.

Environment: STAND_IN_PASS_S is how long a pass takes before it writes.
"""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Mapping

from fleet_operator.__main__ import run
from fleet_operator.cluster.connection import Connection
from fleet_operator.config import Config
from fleet_operator.resources import names
from fleet_operator.resources.refs import FLEET_SPEC, Manifest, ObjectRef

log = logging.getLogger("stand-in")


class StandIn:
    """Notes in a ConfigMap who saw which generation of a fleet."""

    def __init__(self, config: Config, connection: Connection) -> None:
        self._identity = config.identity
        self._cluster = connection.cluster

    async def reconcile(self, ref: ObjectRef) -> float | None:
        log.info("pass of %s", ref.name)
        await asyncio.sleep(float(os.environ.get("STAND_IN_PASS_S", "0")))
        body = self._cluster.fleet(ref)
        if body is None:
            return None
        owner = {"apiVersion": FLEET_SPEC.api_version, "kind": FLEET_SPEC.kind, "name": ref.name}
        labels = {names.FLEET_LABEL: ref.name}
        metadata: Manifest = {"name": f"{ref.name}-seen", "namespace": ref.namespace, "labels": labels}
        metadata["ownerReferences"] = [{**owner, "uid": body["metadata"]["uid"], "controller": True}]
        data = {"by": self._identity, "generation": str(body["metadata"]["generation"])}
        await self._cluster.apply({"apiVersion": "v1", "kind": "ConfigMap", "metadata": metadata, "data": data})
        await self._cluster.apply_status(FLEET_SPEC, ref, {"phase": "Seen"})
        log.info("saw %s", ref.name)
        return None

    async def forget(self, ref: ObjectRef, last: Manifest | None) -> None:
        log.info("forget %s of generation %s", ref.name, last and last["metadata"]["generation"])

    async def sweep(self, alive: Mapping[ObjectRef, str]) -> None:
        log.info("sweep beside %s", sorted(ref.name for ref in alive))


if __name__ == "__main__":
    code = run(StandIn)
    logging.shutdown()
    os._exit(code)

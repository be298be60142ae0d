"""How long it takes from a change to what the operator makes of it, while all fleets are there."""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass, field

from bench.operator_scale.client import MERGE, Client, Manifest
from bench.operator_scale.fleets import NAMESPACE, name
from fleet_operator.resources import names
from fleet_operator.resources.refs import FLEET_SPEC, JOB, MISSION
from fleet_operator.resources.roles import TrainerTask

_APART_S = 1.0
_PATIENCE_S = 240.0
CHANGED = "from a changed FleetSpec to its next Mission"
ENDED = "from the end of a Job to the next Mission"


@dataclass
class Seen:
    """When something was seen, by fleet and mission."""

    made: dict[tuple[str, int], float] = field(default_factory=dict)
    weighed: dict[tuple[str, int], float] = field(default_factory=dict)

    def mission(self, body: Manifest) -> None:
        self.made.setdefault((body["spec"]["fleet"], int(body["spec"]["number"])), time.perf_counter())

    def job(self, body: Manifest) -> None:
        conditions = body.get("status", {}).get("conditions") or ()
        if not any(each["type"] == "Complete" and each["status"] == "True" for each in conditions):
            return
        labels = body["metadata"]["labels"]
        key = labels[names.FLEET_LABEL], int(labels[names.MISSION_LABEL])
        self.weighed.setdefault(key, time.perf_counter())


async def effects(client: Client, count: int) -> dict[str, list[float]]:
    """Times in s: some fleets that are done are given two more missions, one fleet after another."""
    seen = Seen()
    missions, jobs = MISSION.path(NAMESPACE), JOB.path(NAMESPACE)
    weighing = {"labelSelector": f"{names.TASK_LABEL}={TrainerTask.WEIGH.value}"}
    watches = [
        asyncio.create_task(_follow(client, missions, {}, seen.mission)),
        asyncio.create_task(_follow(client, jobs, weighing, seen.job)),
    ]
    await asyncio.sleep(1.0)
    began: dict[str, float] = {}
    for index in range(count):
        began[name(index)] = time.perf_counter()
        path = FLEET_SPEC.path(NAMESPACE, name(index))
        await client.call("PATCH", path, {"spec": {"missions": {"count": 3}}}, MERGE)
        await asyncio.sleep(_APART_S)
    end = time.perf_counter() + _PATIENCE_S
    while any((fleet, 3) not in seen.weighed for fleet in began) and time.perf_counter() < end:
        await asyncio.sleep(0.5)
    for task in watches:
        task.cancel()
    await asyncio.gather(*watches, return_exceptions=True)
    changed = [seen.made[fleet, 2] - at for fleet, at in began.items() if (fleet, 2) in seen.made]
    ended = [
        seen.made[fleet, 3] - seen.weighed[fleet, 2]
        for fleet in began
        if (fleet, 3) in seen.made and (fleet, 2) in seen.weighed
    ]
    return {CHANGED: sorted(changed), ENDED: sorted(ended)}


async def _follow(client: Client, path: str, query: dict[str, str], take: object) -> None:
    async for event in client.watch(path, query):
        if event["type"] in ("ADDED", "MODIFIED") and callable(take):
            take(event["object"])

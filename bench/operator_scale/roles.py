"""What all roles of all fleets would leave in storage, written by one process when KWOK says that their pods run.

python -m bench.operator_scale.roles KUBECONFIG STORAGE_FOLDER
"""

from __future__ import annotations

import asyncio
import contextlib
import sys
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from bench.operator_scale.client import MERGE, Client
from bench.operator_scale.fleets import NAMESPACE, fleet_spec
from fleet.functions.contract import AgentMetrics
from fleet.learning.reward import Normaliser, RewardModel
from fleet.missions.documents import Landing, MissionEvaluation, MissionOrder, RetrainingReport, WeightsDocument, judge
from fleet.missions.records import Record
from fleet.spec.load import parse_fleet_spec
from fleet.storage.layout import FleetPaths
from fleet.storage.local import LocalStorage
from fleet_operator.resources.refs import JOB

WORK_S = 1.4
"""From a pod's start to its documents: after its Job is known to run, and before KWOK ends the pod."""
HOLD = "hold"
"""File beside the storage; as long as it is there, no Job ends."""
_ENDS_AT_ONCE = 16
_FLEET = parse_fleet_spec(fleet_spec(0)).spec
_AGENTS = tuple(agent.name for agent in _FLEET.agents.resolved)
_RUNNING = {"fieldSelector": "status.phase=Running"}


def _json(document: Any) -> bytes:
    text: str = document.model_dump_json(by_alias=True)
    return text.encode()


@cache
def _reward() -> bytes:
    return _json(
        RewardModel(
            features=("exg",),
            weights=(1.0,),
            normaliser=Normaliser(low=(0.0,), high=(1.0,)),
            utility_threshold=1.0,
            visited_threshold=3,
            loss=0.1,
            goals_met=True,
        )
    )


@cache
def _landing(agent: str) -> bytes:
    return _json(Landing(agent=agent, metrics=_metrics(agent)))


def _metrics(agent: str) -> AgentMetrics:
    return AgentMetrics(agent, 1, 1, 10.0, 1000.0, 10.0, 1, 1)


@cache
def _evaluation(number: int) -> bytes:
    metrics = {"accuracy": 0.8, "coverage": 0.5}
    goals, agents = judge(_FLEET.goals, metrics), tuple(_metrics(agent) for agent in _AGENTS)
    return _json(MissionEvaluation(number=number, context="field", metrics=metrics, goals=goals, agents=agents))


@cache
def _report(number: int, subset: str) -> bytes:
    return _json(RetrainingReport(number=number, subset=subset, transitions=1, cpu_s=0.1, wall_s=0.1, energy_j=1.0))


class Roles:
    """All roles.

    Args:
        storage: Of all fleets.
    """

    def __init__(self, storage: LocalStorage) -> None:
        self._storage = storage
        self._landed: dict[tuple[str, int], int] = {}
        self._weights: dict[int, bytes] = {}
        record = Record(0, 0, 0, 0, True, (1.0,), 0, -1, "Land", 10.0, 1000.0)
        self._log = record.to_line()

    def work(self, pod: dict[str, Any]) -> None:
        """Leave what the role of a pod leaves, by the `spec` of the pod."""
        main = pod["containers"][0]
        given = {each["name"]: each.get("value", "") for each in main["env"]}
        paths = FleetPaths(given["FLEET_NAMESPACE"], given["FLEET_NAME"])
        number = int(given.get("FLEET_MISSION", "0"))
        match main["name"]:
            case "workflow":
                self._land(paths, number, given["FLEET_AGENT"])
            case "trainer":
                self._train(paths, number)
            case "aggregator":
                subset = given["FLEET_SUBSET"]
                self._storage.write(paths.model(number, subset), b"model")
                self._storage.write(paths.retraining(number, subset), _report(number, subset))

    def _land(self, paths: FleetPaths, number: int, agent: str) -> None:
        self._storage.append(paths.log(number, agent), self._log)
        self._storage.write(paths.landing(number, agent), _landing(agent))
        landed = self._landed[paths.root, number] = self._landed.get((paths.root, number), 0) + 1
        if landed == len(_AGENTS):
            self._storage.write(paths.evaluation(number), _evaluation(number))

    def _train(self, paths: FleetPaths, number: int) -> None:
        if not number:
            self._storage.write(paths.initial_model, b"model")
            self._storage.write(paths.reward, _reward())
            return
        if number not in self._weights:
            order = MissionOrder.model_validate_json(self._storage.read(paths.plan(number)))
            keys = [model.key for model in order.models]
            even = dict.fromkeys(keys, 1 / len(keys))
            useful: dict[str, float | None] = {**even}
            document = WeightsDocument(number=number + 1, weights=dict.fromkeys(_AGENTS, even), usefulness=useful)
            self._weights[number] = _json(document)
        self._storage.write(paths.weights(number + 1), self._weights[number])


async def serve(kubeconfig: Path, roles: Roles) -> None:
    """Work for pods that run; until killed."""
    loop = asyncio.get_running_loop()
    async with Client(kubeconfig) as client:
        async for event in client.watch(f"/api/v1/namespaces/{NAMESPACE}/pods", _RUNNING):
            if event["type"] == "ADDED":
                loop.call_later(WORK_S, roles.work, event["object"]["spec"])


async def serve_jobs(kubeconfig: Path, roles: Roles, order: Path) -> None:
    """Work for Jobs, and end them; until killed. Nothing ends as long as the file `order` is there."""
    ends: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
    loop = asyncio.get_running_loop()
    async with Client(kubeconfig) as client, asyncio.TaskGroup() as tasks:
        for _ in range(_ENDS_AT_ONCE):
            tasks.create_task(_end_jobs(client, roles, ends, order))
        async for event in client.watch(JOB.path(NAMESPACE), {}):
            job = event["object"]
            if event["type"] == "ADDED" and not job["spec"].get("suspend"):
                loop.call_later(WORK_S, ends.put_nowait, job)


async def _end_jobs(client: Client, roles: Roles, ends: asyncio.Queue[dict[str, Any]], order: Path) -> None:
    while True:
        job = await ends.get()
        while order.exists():
            await asyncio.sleep(0.2)
        roles.work(job["spec"]["template"]["spec"])
        now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        conditions = [
            {"type": kind, "status": "True", "reason": "CompletionsReached", "lastProbeTime": now,
             "lastTransitionTime": now}
            for kind in ("SuccessCriteriaMet", "Complete")
        ]  # fmt: skip
        counts = {"active": 0, "ready": 0, "terminating": 0, "succeeded": 1, "uncountedTerminatedPods": {}}
        status = {**counts, "startTime": now, "completionTime": now, "conditions": conditions}
        await client.call("PATCH", f"{JOB.path(NAMESPACE, job['metadata']['name'])}/status", {"status": status}, MERGE)


if __name__ == "__main__":
    folder = Path(sys.argv[2])
    works = Roles(LocalStorage(folder))
    given = Path(sys.argv[1])
    serving = serve(given, works) if sys.argv[3] == "pods" else serve_jobs(given, works, folder.parent / HOLD)
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(serving)

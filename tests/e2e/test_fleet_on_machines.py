"""A swarm by kubectl on real machines, over real HDFS: what comes of it, what survives, and what is left.

The tests tell one story, in this order: two missions; their FleetSpec is deleted and another goes on from the data
with a third mission, in which much breaks; at last everything is deleted.
"""

from __future__ import annotations

import json
import subprocess
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import Any
from zipfile import ZipFile

import pytest

from fleet.missions.documents import MissionEvaluation
from fleet.missions.records import read_log
from fleet.storage.hdfs import HdfsStorage
from fleet.storage.layout import CLAIMS
from fleet.storage.local import LocalStorage
from fleet_operator.flow.claims import read_claim
from fleet_operator.resources import names
from fleet_operator.resources.roles import Role
from tests.e2e.swarms import FLEET, PATIENCE_S, Swarm, write_spec
from tests.scouting import finish, running, words
from tests.testbed.bed import Bed

pytestmark = [pytest.mark.xdist_group("bed"), pytest.mark.slow]

NAMESPACE = "fields"
AGENTS = ("agent-1", "agent-2")
CALM = {"count": 2, "clock": "Accelerated", "agentRetries": 6}
STORMY = {"count": 3, "clock": "Real", "agentRetries": 6}
TIMES_TAKEN = ("retraining/", "weighing.json", "training/report.json")
"""Documents that say how long something took."""
OF_THE_CLUSTER = {"functions.json"} | {f"contexts/{name}/origin.json" for name in ("first", "second", "third")}
"""What the operator notes for itself, and `fleet run` has no need of."""
LOOK = """
import json, pathlib
lines = pathlib.Path("/proc/self/status").read_text().splitlines()
status = dict(line.split(":\\t", 1) for line in lines if ":\\t" in line)
def writes(path):
    try:
        pathlib.Path(path).write_text("x")
    except OSError as error:
        return error.strerror
    return "written"
print(json.dumps({
    "user": sorted(set(status["Uid"].split() + status["Gid"].split())),
    "capabilities": {status[name] for name in ("CapEff", "CapPrm", "CapBnd")} == {"0" * 16},
    "gains no privilege": status["NoNewPrivs"],
    "seccomp": status["Seccomp"],
    "root": writes("/x"),
    "functions": writes("/fleet/functions/x"),
    "scratch": writes("/tmp/x"),
    "secrets": [str(path) for path in pathlib.Path("/run/secrets").rglob("*")],
}))
"""
CONFINED = {
    "user": ["65532"],
    "capabilities": True,
    "gains no privilege": "1",
    "seccomp": "2",
    "root": "Read-only file system",
    "functions": "Read-only file system",
    "scratch": "written",
    "secrets": [],
}


@pytest.fixture(scope="module")
def swarm(bed: Bed, installed: HdfsStorage, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Swarm]:
    """The swarm in a namespace that lets in what keeps to the strictest standard of Kubernetes, and nothing else."""
    bed.kubectl("create", "namespace", NAMESPACE)
    bed.kubectl("label", "namespace", NAMESPACE, "pod-security.kubernetes.io/enforce=restricted")
    yield Swarm(bed, installed, NAMESPACE, tmp_path_factory.mktemp("swarm"))
    bed.kubectl("delete", "namespace", NAMESPACE, "--wait=false")


@pytest.fixture(scope="module")
def home_run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """Three missions of the same swarm by `fleet run` on this computer, while the cluster flies; its folder."""
    folder = tmp_path_factory.mktemp("at-home")
    file = write_spec(folder / "swarm", NAMESPACE, **CALM)
    with running(file, folder / "out", "--missions", "3") as run:
        yield run, folder / "out"


@pytest.fixture(scope="module")
def at_home(home_run: tuple[subprocess.Popen[str], Path], swarm: Swarm) -> dict[str, bytes]:
    """What those missions leave."""
    run, out = home_run
    assert finish(run, out, PATIENCE_S) in {0, 1}, words(out)
    storage, root = LocalStorage(out / "storage"), swarm.paths.root
    return {entry.path.removeprefix(f"{root}/"): storage.read(entry.path) for entry in storage.list(root)}


@pytest.fixture(scope="module")
def flown(swarm: Swarm, home_run: object) -> dict[str, bytes]:
    """Two missions on the cluster; what they leave."""
    swarm.apply(**CALM)
    swarm.wait("condition=GoalsMet")
    swarm.wait("jsonpath={.status.phase}=Done")
    return swarm.content()


@pytest.fixture(scope="module")
def adopted(swarm: Swarm, flown: dict[str, bytes]) -> None:
    """The FleetSpec is deleted, its data stays, and another FleetSpec begins a third mission."""
    swarm.kubectl("delete", "fleetspec", FLEET)
    swarm.wait_for("the end of what was made for the FleetSpec", lambda: swarm.objects() == [])
    swarm.wait_for("the claim to be given up", lambda: not swarm.storage.exists(swarm.paths.claim))
    assert swarm.content() == flown, "the data stays"
    swarm.apply(**STORMY)


@pytest.fixture(scope="module")
def weathered(bed: Bed, swarm: Swarm, adopted: None) -> dict[str, Any]:
    """The third mission, in which a machine, a pod and a DataNode are lost at once; what was seen on the way."""
    for agent in AGENTS:
        swarm.wait_for(f"{agent} to fly", lambda agent=agent: len(swarm.log(3, agent)) > 2)  # type: ignore[misc]
    pods = {agent: swarm.pod(names.mission_job(Role.WORKFLOW, FLEET, 3, agent)) for agent in AGENTS}
    seen: dict[str, Any] = {"confined": _look_into(swarm, pods["agent-2"])}
    lost = bed.machine(pods["agent-1"]["spec"]["nodeName"])
    assert lost.name.startswith("edge"), "workflows prefer the gateways"
    seen["acknowledged"] = {agent: swarm.log(3, agent) for agent in AGENTS}
    lost.power_off()
    try:
        _evict(swarm, pods["agent-2"]["metadata"]["name"])
        _kill_datanode(bed, besides=lost.name)
        swarm.wait_for("the lost machine to be told", lambda: "NodeLost" in swarm.reasons())
    finally:
        lost.wake()
    swarm.wait("jsonpath={.status.phase}=Done")
    swarm.wait("condition=Degraded=False")
    swarm.wait_for("the woken machine to be Ready", lambda: lost.ready)
    return seen


def test_two_missions_by_kubectl_leave_what_they_leave_at_home(
    flown: dict[str, bytes], at_home: dict[str, bytes], swarm: Swarm
) -> None:
    expected = {path: data for path, data in at_home.items() if not path.startswith(("missions/0003", "missions/0004"))}
    # Weights for a third mission are found after the second; that it was the last is not known then.
    expected["missions/0003/weights.json"] = at_home["missions/0003/weights.json"]
    assert set(flown) - set(expected) == OF_THE_CLUSTER
    assert set(expected) - set(flown) == set()
    assert _differing(flown, expected) == []
    assert {path: swarm.storage.copies(f"{swarm.paths.root}/{path}") for path in flown} == dict.fromkeys(flown, 2)
    evaluation = MissionEvaluation.model_validate_json(flown["missions/0002/evaluation.json"])
    assert evaluation.goals_met
    mission = swarm.get("mission", names.mission(FLEET, 2))["status"]
    assert (mission["landed"], mission["goalsMet"]) == ("2/2", True)
    assert mission["evaluation"] == pytest.approx(evaluation.metrics)


def test_every_job_ran_exactly_once(flown: dict[str, bytes], swarm: Swarm) -> None:
    started = swarm.get("events", "--field-selector", "involvedObject.kind=Job,reason=SuccessfulCreate")["items"]
    pods = Counter({each["involvedObject"]["name"]: each.get("count", 1) for each in started})
    of_a_mission = [
        *(names.mission_job(role, FLEET, 1, agent) for role in (Role.SENSOR, Role.WORKFLOW) for agent in AGENTS),
        *(names.mission_job(Role.AGGREGATOR, FLEET, 1, subset) for subset in ("1", "2", "1-2")),
        names.weighing_job(FLEET, 1),
    ]
    both = [*of_a_mission, *(name.replace("m0001", "m0002") for name in of_a_mission)]
    assert pods == dict.fromkeys([names.training_job(FLEET), *both], 1)
    jobs = {job["metadata"]["name"]: job["status"] for job in swarm.get("jobs")["items"]}
    assert sorted(jobs) == sorted(both), "the Jobs of the last two missions are kept for their logs"
    ends = {name: (status.get("succeeded"), status.get("failed", 0)) for name, status in jobs.items()}
    assert ends == dict.fromkeys(both, (1, 0))


def test_data_outlives_its_fleetspec_and_another_goes_on_from_it(
    weathered: dict[str, Any], flown: dict[str, bytes], swarm: Swarm
) -> None:
    assert "Adopted" in swarm.reasons()
    content = swarm.content()
    kept = [path for path in flown if path != "fleet.json"]
    assert [path for path in kept if content.get(path) != flown[path]] == []
    assert swarm.get("fleetspec", FLEET)["status"]["missionsFlown"] == 3
    assert names.training_job(FLEET) not in {job["metadata"]["name"] for job in swarm.get("jobs")["items"]}


def test_a_mission_survives_the_loss_of_a_machine_a_pod_and_a_datanode(
    weathered: dict[str, Any], at_home: dict[str, bytes], bed: Bed, swarm: Swarm
) -> None:
    for agent, records in weathered["acknowledged"].items():
        assert swarm.log(3, agent)[: len(records)] == records, "an acknowledged record is lost"
    content = swarm.content()
    third = {path: data for path, data in at_home.items() if path.startswith(("missions/0003", "missions/0004"))}
    assert set(third) - set(content) == set()
    assert _differing(content, third) == []
    assert swarm.last_told("NodeLost") <= swarm.last_told("Recovered")
    bed.wait_ready(PATIENCE_S)
    swarm.wait_for(
        "two copies of every file",
        lambda: {swarm.storage.copies(f"{swarm.paths.root}/{path}") for path in content} == {2},
    )


def test_pods_are_confined_in_deed(weathered: dict[str, Any]) -> None:
    assert weathered["confined"] == dict.fromkeys(("workflow", "map", "eval"), CONFINED)


def test_nothing_is_left_of_a_fleet_that_takes_its_data_along(weathered: dict[str, Any], swarm: Swarm) -> None:
    patch = json.dumps({"spec": {"storage": {"onDelete": "Delete"}}})
    swarm.kubectl("patch", "fleetspec", FLEET, "--type=merge", "--patch", patch)

    def noted() -> bool:
        claim = read_claim(swarm.storage, swarm.paths)
        return claim is not None and claim.on_delete == "Delete"

    swarm.wait_for("what is to become of the data to be noted", noted)
    swarm.kubectl("delete", "fleetspec", FLEET)
    swarm.wait_for(
        "the end of everything", lambda: swarm.objects() == [] and swarm.storage.list(swarm.paths.root) == []
    )
    swarm.wait_for("the end of the claim", lambda: swarm.storage.list(CLAIMS) == [])


def _differing(found: dict[str, bytes], expected: dict[str, bytes]) -> list[str]:
    """Paths whose contents differ."""
    same = [path for path in expected if not any(part in path for part in TIMES_TAKEN)]
    return [path for path in same if _content(path, found[path]) != _content(path, expected[path])]


def _content(path: str, data: bytes) -> object:
    """The bytes, but for what is another's: zlib packs archives, uids are the cluster's, a torn line is no record."""
    match PurePosixPath(path).name:
        case name if name.endswith(".npz"):
            with ZipFile(BytesIO(data)) as archive:
                return {member: archive.read(member) for member in archive.namelist()}
        case "fleet.json":
            spec = json.loads(data)["spec"]
            return spec | {"missions": spec["missions"] | {"count": 0}}
        case "log.jsonl":
            return read_log(data)
        case _:
            return data


def _look_into(swarm: Swarm, pod: dict[str, Any]) -> dict[str, Any]:
    """What the containers of a pod can and cannot do."""
    containers = ("workflow", "map", "eval")
    with ThreadPoolExecutor() as pool:  # at once: the mission goes on meanwhile
        found = pool.map(lambda container: swarm.run_in(pod["metadata"]["name"], container, LOOK), containers)
        return dict(zip(containers, found, strict=True))


def _evict(swarm: Swarm, pod: str) -> None:
    body = {"apiVersion": "policy/v1", "kind": "Eviction", "metadata": {"name": pod, "namespace": swarm.namespace}}
    path = f"/api/v1/namespaces/{swarm.namespace}/pods/{pod}/eviction"
    swarm.cluster.kubectl("create", "--raw", path, "-f", "-", stdin=json.dumps(body))


def _kill_datanode(bed: Bed, besides: str) -> None:
    """Delete a DataNode's pod, not that of a machine."""
    pods = bed.get("pods", "-n", "fleet-system", "-l", "app.kubernetes.io/component=datanode")["items"]
    name = next(pod["metadata"]["name"] for pod in pods if pod["spec"]["nodeName"] != besides)
    bed.kubectl("delete", "pod", name, "-n", "fleet-system", "--wait=false")

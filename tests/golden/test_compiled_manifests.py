"""What `fleet compile` prints, held against files that were read by people; --update-golden writes them anew."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from fleet.spec.resources import FleetSpec
from fleet_operator.compiler.bundle import Bundle
from fleet_operator.compiler.fleet import compile_fleet, to_yaml
from fleet_operator.compiler.missions import compile_flight, compile_retraining, evaluate_job, mission_manifest
from fleet_operator.compiler.network import network_policies
from fleet_operator.compiler.settings import Settings
from fleet_operator.compiler.target import AggregatorTerms, Owner, Placement, Target
from fleet_operator.local.workloads import parse_job, parse_service
from fleet_operator.policy.shares import Capacity, Share

FOLDER = Path(__file__).parent / "compile"
FUNCTIONS = {"crop_scouting.py": b"def map_observation(observation):\n    return {'exg': 1.0}\n"}
BASE: dict[str, Any] = {
    "agents": {"count": 2},
    "stateSpace": {"context": "field"},
    "map": {"function": "crop_scouting:map_observation"},
    "eval": {"function": "crop_scouting:evaluate"},
    "contexts": [{"name": "field", "uri": "field", "use": ["Shaping", "Training", "Mission"]}],
    "goals": [{"metric": "accuracy", "atLeast": 0.7}],
}
MEMBERS = [
    {"name": "scout", "actions": ["North", "South", "East", "West", "NorthEast"]},
    {"name": "a-mapper-with-a-name-of-forty-characters", "start": {"row": 3, "column": 2}},
]
IMAGE = {"image": "registry.example/map:1", "command": ["/serve"], "resources": {"limits": {"memory": "1Gi"}}}
TERMS = [
    AggregatorTerms("1", 9, Share(Capacity(1.5, 2**30), Capacity(0.15, 2**27))),
    AggregatorTerms("2", 1, Share(Capacity(0.1, 2**20), Capacity(0.05, 2**20))),
    AggregatorTerms("1-2", 0),
]
CASES: dict[str, tuple[dict[str, Any], dict[str, bytes], list[AggregatorTerms]]] = {
    "two-agents": ({}, FUNCTIONS, TERMS),
    "different-agents": ({"agents": {"members": MEMBERS}}, FUNCTIONS, TERMS[2:]),
    "image-functions": ({"map": IMAGE, "eval": {"image": "registry.example/eval:1"}}, {}, TERMS[:1]),
    "twelve-agents": (
        {
            "agents": {"count": 12},
            "workflow": {"trainerResources": {"limits": {"cpu": "6"}}},
            "missions": {"agentRetries": 5},
            "storage": {"uri": "hdfs://elsewhere:8020"},
        },
        FUNCTIONS,
        [AggregatorTerms(key, 1) for key in (*map(str, range(1, 13)), "all")],
    ),
}
OWNER = Owner("fleetcomputer.io/v1alpha1", "FleetSpec", "crop-scouting", "5d0c8b1e-0000-4000-8000-000000000000")
PLACES = {"1": Placement({"edge-1": 3_000_000, "edge-2": 1_000_000, "edge-3": 1_000}), "2": Placement()}
ALL = [*CASES, "second-mission-in-a-cluster"]


def target_of(changes: dict[str, Any], files: dict[str, bytes], **given: Any) -> Target:
    document = {"metadata": {"name": "crop-scouting", "namespace": "fields"}, "spec": {**BASE, **changes}}
    settings = Settings(runtime_image="fleet-computer/runtime:golden", **given.pop("settings", {}))
    return Target(FleetSpec.model_validate(document), Bundle(files), settings, **given)


def second_mission() -> list[dict[str, Any]]:
    """What an operator applies when it owns everything, the storage is a volume, and the data has places."""
    volume = {"storage_uri": "file:///fleet/storage", "storage_claim": "fleet-computer-storage"}
    target = target_of({}, {}, settings=volume, owner=OWNER)
    return [
        *network_policies(target),
        mission_manifest(target, 2),
        *compile_flight(target, 2, ["agent-2"]),
        evaluate_job(target, 2, "agent-1"),
        *compile_retraining(target, 2, TERMS, PLACES),
    ]


def compiled(case: str) -> list[dict[str, Any]]:
    if case not in CASES:
        return second_mission()
    changes, files, terms = CASES[case]
    return compile_fleet(target_of(changes, files), terms)


@pytest.mark.parametrize("case", ALL)
def test_manifests_are_as_they_were_read(case: str, update_golden: bool) -> None:
    file = FOLDER / f"{case}.yaml"
    text = to_yaml(compiled(case))
    if update_golden:
        file.write_text(text)
    assert text == file.read_text()


@pytest.mark.parametrize("case", ALL)
def test_the_yaml_says_what_was_compiled(case: str) -> None:
    assert list(yaml.safe_load_all(to_yaml(compiled(case)))) == compiled(case)


@pytest.mark.parametrize("case", CASES)
def test_the_local_runner_understands_every_object(case: str) -> None:
    for manifest in compiled(case):
        match manifest["kind"]:
            case "Job":
                assert parse_job(manifest).name == manifest["metadata"]["name"]
            case "Service":
                service = parse_service(manifest)
                jobs = [parse_job(each) for each in compiled(case) if each["kind"] == "Job"]
                assert [job.name for job in jobs if service.selects(job)] == [service.name]
            case kind:
                assert kind in {"PriorityClass", "ConfigMap", "NetworkPolicy", "Mission"}


@pytest.mark.parametrize("case", ALL)
def test_every_container_is_hardened_and_has_requests_and_limits(case: str) -> None:
    for job in (each for each in compiled(case) if each["kind"] == "Job"):
        pod = job["spec"]["template"]["spec"]
        assert pod["automountServiceAccountToken"] is False
        assert pod["securityContext"]["runAsNonRoot"] is True
        assert pod["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
        for container in [*pod.get("initContainers", []), *pod["containers"]]:
            assert container["securityContext"] == {
                "allowPrivilegeEscalation": False,
                "readOnlyRootFilesystem": True,
                "capabilities": {"drop": ["ALL"]},
            }
            assert {"name": f"tmp-{container['name']}", "mountPath": "/tmp"} in container["volumeMounts"]
            assert container.get("workingDir") != "/tmp"
            assert [sorted(container["resources"][kind]) for kind in ("requests", "limits")] == [["cpu", "memory"]] * 2


def test_names_are_unique_within_their_kind() -> None:
    for case in ALL:
        found = [(each["kind"], each["metadata"]["name"]) for each in compiled(case)]
        assert len(set(found)) == len(found)


def test_the_fleet_spec_owns_everything_that_is_made_for_it() -> None:
    owned = {str(each["metadata"].get("ownerReferences")) for each in second_mission()}
    reference = {"apiVersion": OWNER.api_version, "kind": OWNER.kind, "name": OWNER.name, "uid": OWNER.uid}
    assert owned == {str([{**reference, "controller": True}])}


def test_level_and_priority_class_agree_and_level_0_is_suspended() -> None:
    classes = {each["metadata"]["name"]: each["value"] for each in compiled("two-agents") if "value" in each}
    jobs = [each for each in compiled("two-agents") if each["kind"] == "Job"]
    found = {
        job["metadata"]["labels"]["fleetcomputer.io/role"]
        + job["metadata"]["labels"].get("fleetcomputer.io/subset", ""): (
            classes[job["spec"]["template"]["spec"]["priorityClassName"]],
            job["spec"]["suspend"],
        )
        for job in jobs
    }
    assert found == {
        "Trainer": (900_000_000, False),
        "Sensor": (1_000_000_000, False),
        "Workflow": (1_000_000_000, False),
        "Aggregator1": (900_000_000, False),
        "Aggregator2": (100_000_000, False),
        "Aggregator1-2": (0, True),
    }

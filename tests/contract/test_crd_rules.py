"""Kubernetes refuses what `fleet` refuses, as far as a schema and CEL can say it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from fleet.errors import SpecError
from fleet.spec.cel import RULES
from fleet.spec.load import parse_edge_node, parse_fleet_spec, parse_mission
from tests.contract.api_server import refusals
from tests.spec_documents import Document, edge_node_document, fleet_document, mission_document

ROOT = Path(__file__).parents[2]
BROKEN = sorted((ROOT / "tests" / "golden" / "broken_specs").glob("*.yaml"))
NOT_A_RESOURCE = {"01", "02", "03", "04", "05", "06", "07", "08", "09", "10", "11", "46"}
"""Broken specs that do not get as far as the schema: no YAML, other kinds, a field twice."""


def schema(plural: str) -> dict[str, Any]:
    crd = yaml.safe_load((ROOT / "crds" / f"{plural}.yaml").read_text(encoding="utf-8"))
    found: dict[str, Any] = crd["spec"]["versions"][0]["schema"]["openAPIV3Schema"]
    return found


FLEETS, MISSIONS, EDGE_NODES = schema("fleetspecs"), schema("missions"), schema("edgenodes")


@pytest.mark.parametrize("path", [path for path in BROKEN if path.name[:2] not in NOT_A_RESOURCE], ids=lambda p: p.stem)
def test_kubernetes_refuses_every_broken_spec(path: Path) -> None:
    assert refusals(FLEETS, yaml.safe_load(path.read_text(encoding="utf-8"))) != []


def given(**spec: Any) -> Document:
    return fleet_document(**spec)


WEIGHTED = {"rewardShaping": {"weights": {"exg": 1}}, "ha": {"utilityThreshold": 1, "visitedThreshold": 3}}
ADDRESS = "uri must be an address of a storage, as webhdfs://fleet@namenode:9870/fleet or file:///var/fleet"
ONE_CONTEXT = [{"name": "september", "uri": "here", "use": ["Mission"]}]
AGENT_RULE = "give either count or members, and not both"
SHAPING_RULE = (
    "one of contexts must have Shaping in its use, or rewardShaping.weights, ha.utilityThreshold and "
    "ha.visitedThreshold must all be given"
)
TRAINING_RULE = "one of contexts must have Training in its use, or sa.pretrained must be given"
MISSION_RULE = "stateSpace.context must be the name of one of contexts that has Mission in its use"
POWERSET_RULE = "Powerset is for up to 8 agents: write EachAndAll, Neighbours or Custom"
FUNCTION_RULE = "give either function or image, and not both"
CUSTOM_RULE = "function is needed with kind Custom, and has no meaning with another kind"
MEMORY_RULE = "memory is in bytes, and less than 1Mi can hold no program: write 256Mi, not 256 or 256m"
PLANNER_GOAL = "Planner lands when its map is accurate enough: one of goals must be for accuracy, with atLeast"
PLANNER_MOVES = "Planner flies along rows and columns: every agent must have North, South, East and West in its actions"
PLANNER_CHECKS = "AfterGroup asks Eval() when a state group is left, and Planner has none: write AtEnd"
PLANNER_WEIGHTS = "a Planner weighs doubt, doubt_around, novelty, and nothing else"
PLANNER = {"sa": {"kind": "Planner"}}
CARDINAL = ["North", "South", "East", "West"]
CPU_RULE = "cpu is in cores, and no machine has more than 1000: write 500m or 2"


@pytest.mark.parametrize(
    ("document", "rules"),
    [
        (given(), []),
        (given(agents=None), []),
        (given(agents={"count": 2, "members": []}), []),
        (given(agents={"members": [{"name": "scout"}]}), []),
        (given(agents={"driver": "Replay"}), [AGENT_RULE]),
        (given(agents={"members": []}), [AGENT_RULE]),
        (given(agents={"count": 1, "members": [{"name": "scout"}]}), [AGENT_RULE]),
        (given(agents={"count": 2, "requires": ["Gimbal"]}), [rule.message for rule in RULES["Agents"][-1:]]),
        (given(contexts=ONE_CONTEXT, **WEIGHTED, sa={"pretrained": "model.npz"}), []),
        (given(contexts=ONE_CONTEXT, **WEIGHTED), [TRAINING_RULE]),
        (given(contexts=ONE_CONTEXT, sa={"pretrained": "model.npz"}), [SHAPING_RULE]),
        (given(contexts=ONE_CONTEXT, **WEIGHTED | {"ha": {}}, sa={"pretrained": "m"}), [SHAPING_RULE]),
        (given(contexts=ONE_CONTEXT, **PLANNER), []),
        (given(agents=None, **PLANNER), []),
        (given(goals=[{"metric": "coverage", "atLeast": 0.5}], **PLANNER), [PLANNER_GOAL]),
        (given(goals=[{"metric": "accuracy", "atMost": 0.5}], **PLANNER), [PLANNER_GOAL]),
        (given(goals=[{"metric": "a", "atMost": 1}, {"metric": "accuracy", "atLeast": 0.5}], **PLANNER), []),
        (given(agents={"count": 2, "actions": [*CARDINAL, "NorthEast"]}, **PLANNER), []),
        (given(agents={"count": 2, "actions": CARDINAL[1:]}, **PLANNER), [PLANNER_MOVES]),
        (given(agents={"count": 2, "actions": ["North"]}), []),
        (
            given(agents={"members": [{"name": "a", "actions": CARDINAL}], "actions": ["North"]}, **PLANNER),
            [],
        ),
        (given(agents={"members": [{"name": "a"}], "actions": ["North"]}, **PLANNER), [PLANNER_MOVES]),
        (
            given(agents={"members": [{"name": "a"}, {"name": "b", "actions": ["East"]}]}, **PLANNER),
            [PLANNER_MOVES],
        ),
        (given(eval={"function": "a:b", "checks": "AfterGroup"}, **PLANNER), [PLANNER_CHECKS]),
        (given(**PLANNER, rewardShaping={"weights": {"exg": 1.0}}), [PLANNER_WEIGHTS]),
        (given(**PLANNER, rewardShaping={"weights": {"novelty": 0.0}}), []),
        (given(eval={"function": "a:b", "checks": "AfterGroup"}), []),
        (
            given(
                agents={"count": 2, "actions": ["North"]},
                eval={"function": "a:b", "checks": "AfterGroup"},
                goals=[{"metric": "coverage", "atLeast": 0.5}],
                **PLANNER,
            ),
            [PLANNER_GOAL, PLANNER_MOVES, PLANNER_CHECKS],
        ),
        (given(stateSpace={"context": "june"}), [MISSION_RULE]),
        (given(stateSpace={"context": "october"}), [MISSION_RULE]),
        (given(agents={"count": 8}, aggregation={"kind": "Powerset"}), []),
        (given(agents={"count": 9}), []),
        (given(agents={"count": 9}, aggregation={"kind": "Powerset"}), [POWERSET_RULE]),
        (
            given(agents={"members": [{"name": f"a{i}"} for i in range(9)]}, aggregation={"kind": "Powerset"}),
            [POWERSET_RULE],
        ),
        (given(aggregation={"kind": "Custom", "function": "crops:pairs"}), []),
        (given(aggregation={"kind": "Custom"}), [CUSTOM_RULE]),
        (given(aggregation={"function": "crops:pairs"}), [CUSTOM_RULE]),
        (given(map={"image": "farm/map:1", "command": ["serve"]}), []),
        (given(map={}), [FUNCTION_RULE]),
        (given(map={"function": "a:b", "image": "farm/map:1"}), [FUNCTION_RULE]),
        (given(map={"function": "a:b", "command": ["serve"]}), ["command is for an image; a function has none"]),
        (given(map={"function": "a:b", "command": []}), []),
        (given(eval={"function": "a:b", "timeout": "0m0s"}), ["timeout must be more than 0s"]),
        (given(goals=[{"metric": "a"}]), ["give atLeast, atMost, or both"]),
        (
            given(goals=[{"metric": "a", "atLeast": 2, "atMost": 1.5}]),
            ["atLeast must not be more than atMost: no value could meet both"],
        ),
        (given(goals=[{"metric": "a", "atLeast": 1, "atMost": 1.5}]), []),
        (
            given(aggregation={"resources": {"requests": {"cpu": 2}, "limits": {"cpu": "1500m"}}}),
            ["requests.cpu must not be more than limits.cpu"],
        ),
        (
            given(aggregation={"resources": {"requests": {"memory": "1Gi"}, "limits": {"memory": "1G"}}}),
            ["requests.memory must not be more than limits.memory"],
        ),
        (given(aggregation={"resources": {"requests": {"memory": "1G"}, "limits": {"memory": "1Gi", "cpu": 1}}}), []),
        (given(workflow={"resources": {"limits": {"memory": 256}}}), [MEMORY_RULE]),
        (given(workflow={"resources": {"limits": {"cpu": "256Mi"}}}), [CPU_RULE]),
        (given(scheduling={"cpu": "4Gi", "memory": "4"}), [MEMORY_RULE, CPU_RULE]),
        (given(storage={"uri": "file:///var/fleet"}), []),
        (given(storage={"uri": "webhdfs://fleet@namenode:9870/fleet?replication=3"}), []),
        (given(storage={"uri": "/var/fleet"}), [ADDRESS]),
        (given(storage={"uri": "hdfs://namenode:8020/fleet"}), [ADDRESS]),
        (given(storage={"uri": "webhdfs://namenode:9870/"}), [ADDRESS]),
        (given(missions={"schedule": "0 6 * * mon-fri"}), []),
        (given(missions={"schedule": "0 6 * * *", "interval": "0s"}), []),
        (
            given(missions={"schedule": "0 6 * * *", "interval": "5m"}),
            ["give either interval or schedule, and not both"],
        ),
        (given(rewardShaping={"weights": {}}), []),
        (
            given(rewardShaping={"weights": {"exg": 0}}),
            ["at least one weight must be more than 0: with all at 0, every state is worth the same"],
        ),
    ],
)
def test_fleet_and_kubernetes_agree_on_fleet_specs(document: Document, rules: list[str]) -> None:
    refused = refusals(FLEETS, document)
    assert [text.partition(": ")[2] for text in refused] == rules
    if rules:
        with pytest.raises(SpecError) as caught:
            parse_fleet_spec(document)
        assert len(caught.value.problems) == len(rules)
    else:
        parse_fleet_spec(document)


def test_every_rule_is_tried_above_or_below() -> None:
    tried = Path(__file__).read_text(encoding="utf-8")
    tried = " ".join(tried.replace('"\n        "', "").replace('"\n    "', "").split())
    rules = {rule.message for name in RULES for rule in RULES[name]} - {rule.message for rule in RULES["Agents"][3:]}
    assert [message for message in sorted(rules) if message not in tried] == []


TWO = {"members": [{"name": "scout"}, {"name": "mapper"}]}
TURNED = {"members": [{"name": "mapper"}, {"name": "scout"}]}
AGENTS = (
    "the number of agents cannot change: models and their weights are kept by subset of the agents. "
    "Make a new FleetSpec"
)
ORDER = (
    "the names and the order of the agents cannot change: models and their weights are kept by subset of the agents. "
    "Make a new FleetSpec"
)
GROUPS = (
    "the size of state groups cannot change: reward shaping found the thresholds of HA for this size. "
    "Make a new FleetSpec"
)
KIND = "the kind of SA cannot change: the models that are there are of this kind. Make a new FleetSpec"
STORAGE = "the storage cannot change: records and models are there. Make a new FleetSpec"


@pytest.mark.parametrize(
    ("before", "after", "rules"),
    [
        (given(), given(), []),
        (given(), given(agents={"count": 5}), [AGENTS]),
        (given(), given(agents=TWO), [AGENTS]),
        (given(agents=TWO), given(agents=TURNED), [ORDER]),
        (given(agents=TWO), given(agents={"members": [*TWO["members"], {"name": "third"}]}), [ORDER]),
        (
            given(agents=TWO),
            given(agents={"members": [{"name": "scout", "actions": ["North"]}, {"name": "mapper"}]}),
            [],
        ),
        (given(), given(stateSpace={"context": "september", "groups": {"rows": 4}}), [GROUPS]),
        (given(), given(stateSpace={"context": "september", "groups": {"order": "Nearest"}}), []),
        (given(), given(sa={"kind": "DQN"}), [KIND]),
        (given(), given(**PLANNER), [KIND]),
        (given(**PLANNER), given(sa={"kind": "Planner", "feature": "exg"}, ha={"caution": 0.5}), []),
        (given(), given(storage={"uri": "file:///var/fleet"}), [STORAGE]),
        (given(), given(map={"image": "farm/map:2"}), []),
        (given(), given(goals=[{"metric": "coverage", "atMost": 0.5}], missions={"count": 9}, suspend=True), []),
    ],
)
def test_what_may_change_in_a_fleet_spec(before: Document, after: Document, rules: list[str]) -> None:
    assert [text.partition(": ")[2] for text in refusals(FLEETS, after, before)] == rules


@pytest.mark.parametrize(
    ("document", "refused"),
    [
        (mission_document(), []),
        (mission_document(number=0), [".spec.number: 0 is out of range"]),
        (mission_document(seed=2**53), [f".spec.seed: {2**53} is out of range"]),
        (mission_document(pilot="me"), [".spec: unknown field pilot"]),
    ],
)
def test_fleet_and_kubernetes_agree_on_missions(document: Document, refused: list[str]) -> None:
    assert refusals(MISSIONS, document) == refused
    if refused:
        with pytest.raises(SpecError):
            parse_mission(document)
    else:
        assert parse_mission(document).spec.fleet == "crops"


def test_a_mission_never_changes() -> None:
    changed = refusals(MISSIONS, mission_document(seed=1), mission_document())
    assert changed == [".spec: a Mission never changes: make a new one"]


@pytest.mark.parametrize(
    ("document", "refused"),
    [
        (edge_node_document(), []),
        (edge_node_document(busyWatts=5), [".spec: busyWatts must be at least idleWatts"]),
        (edge_node_document(bootTime="0s"), [".spec: bootTime must be more than 0s"]),
        (edge_node_document(broadcast="192.168.1.256"), None),
        (edge_node_document(mac="00-1a-2b-3c-4d-5e"), None),
        (edge_node_document(role="hub"), [".spec.role: 'hub' is not a choice"]),
    ],
)
def test_fleet_and_kubernetes_agree_on_edge_nodes(document: Document, refused: list[str] | None) -> None:
    found = refusals(EDGE_NODES, document)
    assert found == refused if refused is not None else found != []
    if found:
        with pytest.raises(SpecError):
            parse_edge_node(document)
    else:
        assert parse_edge_node(document).spec.node == "hub-1.farm"


def test_an_edge_node_stays_the_same_machine() -> None:
    changed = refusals(EDGE_NODES, edge_node_document(node="hub-2"), edge_node_document())
    assert changed == [".spec: node cannot change: another machine is another EdgeNode"]

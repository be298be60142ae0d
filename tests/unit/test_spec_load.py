"""Loading a FleetSpec: what is taken, what is refused, and where the user is sent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from fleet.errors import ExitCode, Problem, SpecError
from fleet.spec.functions import EvalChecks
from fleet.spec.load import (
    load_fleet_spec,
    parse_edge_node,
    parse_fleet_spec,
    parse_mission,
    to_document,
    to_yaml,
)
from fleet.spec.platform import AggregationKind, Deciding, UsefulnessScale
from fleet.spec.swarm import Action, AgentSpec, DriverName
from tests.spec_documents import edge_node_document, fleet_document, mission_document


def problems_of(document: Any) -> list[Problem]:
    with pytest.raises(SpecError) as caught:
        parse_fleet_spec(document)
    return list(caught.value.problems)


def test_the_smallest_spec_has_everything_else_by_default() -> None:
    fleet = parse_fleet_spec(fleet_document()).spec
    chosen = (fleet.aggregation_kind, fleet.usefulness_scale, fleet.eval.checks, fleet.workflow.decide)
    assert chosen == (
        AggregationKind.POWERSET,
        UsefulnessScale.ABSOLUTE,
        EvalChecks.AT_END,
        Deciding.WHILE_MOVING,
    )
    assert [agent.name for agent in fleet.agents.resolved] == ["agent-1", "agent-2", "agent-3", "agent-4"]


def test_members_take_what_they_leave_out_from_the_fleet() -> None:
    members = [{"name": "scout", "actions": ["North"]}, {"name": "mapper", "start": {"row": 1, "column": 2}}]
    agents = parse_fleet_spec(fleet_document(agents={"members": members, "actions": ["East", "West"]})).spec.agents
    scout = AgentSpec(name="scout", driver=DriverName.REPLAY, actions=(Action.NORTH,))
    resolved = [agent.model_dump(exclude={"start"}) for agent in agents.resolved]
    assert resolved == [
        scout.model_dump(exclude={"start"}),
        {"name": "mapper", "driver": DriverName.REPLAY, "actions": (Action.EAST, Action.WEST)},
    ]


@pytest.mark.parametrize(
    ("agents", "kind", "scale"),
    [
        (4, AggregationKind.POWERSET, UsefulnessScale.ABSOLUTE),
        (5, AggregationKind.POWERSET, UsefulnessScale.RELATIVE),
        (9, AggregationKind.EACH_AND_ALL, UsefulnessScale.RELATIVE),
    ],
)
def test_defaults_that_depend_on_the_number_of_agents(
    agents: int, kind: AggregationKind, scale: UsefulnessScale
) -> None:
    fleet = parse_fleet_spec(fleet_document(agents={"count": agents})).spec
    assert (fleet.aggregation_kind, fleet.usefulness_scale) == (kind, scale)


def test_empty_fields_are_as_if_left_out() -> None:
    assert parse_fleet_spec(fleet_document(sa={"kind": None}, storage={})) == parse_fleet_spec(fleet_document())


def test_documents_have_no_defaults_unless_asked() -> None:
    spec = parse_fleet_spec(fleet_document(missions={"count": 3, "seed": 0}))
    short, full = to_document(spec), to_document(spec, defaults=True)
    assert short["spec"]["missions"] == {"count": 3}
    assert full["spec"]["missions"] == {
        "count": 3,
        "interval": "0s",
        "clock": "Accelerated",
        "seed": 0,
        "agentRetries": 20,
    }
    assert "pretrained" not in full["spec"]["sa"]


def test_yaml_is_in_the_order_of_the_reference() -> None:
    text = to_yaml(parse_fleet_spec(fleet_document(missions={"count": 3})))
    fields = [line[2:].split(":")[0] for line in text.splitlines() if line.startswith("  ") and line[2] not in " -"]
    assert fields == ["name", "agents", "stateSpace", "map", "eval", "contexts", "goals", "missions"]


def test_a_quantity_may_be_a_whole_number() -> None:
    limits = parse_fleet_spec(
        fleet_document(map={"function": "a:b", "resources": {"limits": {"cpu": 2, "memory": 268435456}}})
    ).spec.map.resources.limits
    assert (limits.cpu, limits.memory) == ("2", "268435456")


def test_field_names_are_camel_case_only() -> None:
    assert problems_of(fleet_document(stateSpace=None, state_space={"context": "september"})) == [
        Problem("spec.state_space", "there is no such field", "did you mean `stateSpace`?")
    ]


def test_broken_parts_do_not_hide_broken_rules_elsewhere() -> None:
    problems = problems_of(
        fleet_document(agents={"count": "four"}, goals=[{"metric": "accuracy"}, {"metric": "time_s", "atMost": "1h"}])
    )
    assert [(problem.path, problem.message) for problem in problems] == [
        ("spec.agents.count", 'must be a whole number, and is the text "four"'),
        ("spec.goals[0]", "the goal for accuracy has no bound"),
        ("spec.goals[1].atMost", 'must be a number, and is the text "1h"'),
    ]


def test_rules_that_rest_on_broken_parts_are_not_told() -> None:
    problems = problems_of(fleet_document(contexts=[{"name": "September", "uri": "x", "use": ["Mision"]}]))
    assert [problem.path for problem in problems] == ["spec.contexts[0].name", "spec.contexts[0].use[0]"]


@pytest.mark.parametrize("document", [None, [], "text", 3, {}, {"kind": 3}, {"kind": "FleetSpec", "spec": []}])
def test_anything_else_is_refused_in_words(document: Any) -> None:
    assert all(problem.message for problem in problems_of(document))


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"fleet\.yaml cannot be read: no such file or directory") as caught:
        load_fleet_spec(tmp_path / "fleet.yaml")
    assert (caught.value.source, caught.value.exit_code) == (str(tmp_path / "fleet.yaml"), ExitCode.USAGE)


def test_a_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "fleet.yaml").write_bytes(b"\xff\xfe\x00binary")
    with pytest.raises(SpecError, match="is not text in UTF-8"):
        load_fleet_spec(tmp_path / "fleet.yaml")


def test_a_byte_order_mark_does_no_harm(tmp_path: Path) -> None:
    spec = parse_fleet_spec(fleet_document())
    (tmp_path / "fleet.yaml").write_bytes(b"\xef\xbb\xbf" + to_yaml(spec).encode())
    assert load_fleet_spec(tmp_path / "fleet.yaml") == spec


def test_problems_are_in_the_order_of_the_file() -> None:
    error = SpecError([Problem("b", "x", line=9), Problem("a", "x", line=10), Problem("c", "y", "do z", line=2)])
    assert str(error) == "line 2: c: y; do z\nline 9: b: x\nline 10: a: x"


def test_missions_and_edge_nodes() -> None:
    mission, node = parse_mission(mission_document(seed=7)), parse_edge_node(edge_node_document(role="Hub"))
    assert to_document(mission) == mission_document(seed=7)
    assert to_document(node) == edge_node_document(role="Hub")


@pytest.mark.parametrize(
    ("parts", "problem"),
    [
        ({"mac": "001a.2b3c.4d5e"}, ("spec.mac", "write 00:1a:2b:3c:4d:5e")),
        (
            {"mac": "ff:ff:ff:ff:ff:ff"},
            ("spec.mac", "write the address of the machine's network card, as `ip link` shows it"),
        ),
        ({"broadcast": "192.168.1.300"}, ("spec.broadcast", "write 192.168.1.255")),
        ({"busyWatts": 1}, ("spec.busyWatts", "write at least 10")),
        ({"bootTime": "0s"}, ("spec.bootTime", "write the time that it takes, such as 60s")),
        ({"node": "Hub_1"}, ("spec.node", "write hub-1")),
    ],
)
def test_broken_edge_nodes(parts: dict[str, Any], problem: tuple[str, str]) -> None:
    with pytest.raises(SpecError) as caught:
        parse_edge_node(edge_node_document(**parts))
    assert [(found.path, found.hint) for found in caught.value.problems] == [problem]

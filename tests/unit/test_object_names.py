"""Names of objects are valid, deterministic and never the same for two things."""

from __future__ import annotations

import re
from collections.abc import Callable

from hypothesis import given, settings
from hypothesis import strategies as st

from fleet_operator.resources import names
from fleet_operator.resources.roles import Role

FLEET = st.from_regex(r"[a-z0-9]([-a-z0-9]{0,38}[a-z0-9])?", fullmatch=True)
AWKWARD = st.sampled_from(
    [
        "a",
        "a-m0001-sensor-b",
        "a-train",
        "a-m0001-weigh",
        "2018",
        "a-m0001-sensor",
        "b-m0001-sensor-c",
        "a-m0001",
        "a-m0001-evaluate",
        "a-files",
        "a-files-1",
        "a-network",
        "all",
    ]
)
PART = FLEET | AWKWARD
MISSION = st.integers(1, 10_000)
ROLES = st.sampled_from([Role.SENSOR, Role.WORKFLOW, Role.AGGREGATOR])
THING = (
    st.tuples(st.just("job"), PART, MISSION, ROLES, PART)
    | st.tuples(st.just("train"), PART)
    | st.tuples(st.just("weigh"), PART, MISSION)
    | st.tuples(st.just("mission"), PART, MISSION)
    | st.tuples(st.just("evaluate"), PART, MISSION, PART)
    | st.tuples(st.just("files"), PART, st.integers(1, 99))
    | st.tuples(st.just("network"), PART, st.sampled_from(["all", "sensor", "workflow"]))
    | st.tuples(st.just("functions"), PART, st.from_regex(r"[0-9a-f]{8}", fullmatch=True))
)


MAKERS: dict[str, Callable[..., str]] = {
    "job": lambda fleet, mission, role, member: names.mission_job(role, fleet, mission, member),
    "train": names.training_job,
    "weigh": names.weighing_job,
    "mission": names.mission,
    "evaluate": names.evaluate_job,
    "files": names.files,
    "network": names.network_policy,
    "functions": names.functions,
}


def name_of(thing: tuple) -> str:  # type: ignore[type-arg]  # the kinds of things have different lengths
    kind, *what = thing
    return MAKERS[kind](*what)


@given(THING)
@settings(max_examples=200)
def test_every_name_is_a_dns_label_that_begins_with_a_letter(thing: tuple) -> None:  # type: ignore[type-arg]
    assert re.fullmatch(r"[a-z]([-a-z0-9]{0,61}[a-z0-9])?", name_of(thing))


@given(THING, THING)
@settings(max_examples=300)
def test_different_things_have_different_names(one: tuple, other: tuple) -> None:  # type: ignore[type-arg]
    assert (name_of(one) == name_of(other)) == (one == other)


def test_a_fleet_whose_name_reads_like_another_fleets_job_is_told_apart() -> None:
    one = names.mission_job(Role.SENSOR, "a", 1, "b-m0001-sensor-c")
    other = names.mission_job(Role.SENSOR, "a-m0001-sensor-b", 1, "c")
    assert one == "a-m0001-sensor-b-m0001-sensor-c"
    assert other != one


def test_short_names_are_plain() -> None:
    assert names.mission_job(Role.WORKFLOW, "crop-scouting", 3, "agent-12") == "crop-scouting-m0003-workflow-agent-12"
    assert names.training_job("crop-scouting") == "crop-scouting-train"
    assert names.mission("crop-scouting", 3) == "crop-scouting-m0003"
    assert names.evaluate_job("crop-scouting", 3, "agent-1") == "crop-scouting-m0003-evaluate-agent-1"


def test_a_long_name_keeps_its_beginning_and_ends_in_a_hash() -> None:
    name = names.mission_job(Role.SENSOR, "a" * 40, 1, "b" * 40)
    assert re.fullmatch("a{40}-m0001-sensor-[0-9a-f]{8}", name)


@given(st.text(min_size=1, max_size=80))
@settings(max_examples=100)
def test_every_label_value_is_one_that_kubernetes_takes(text: str) -> None:
    assert re.fullmatch(r"([A-Za-z0-9]([-A-Za-z0-9_.]{0,61}[A-Za-z0-9])?)?", names.label_value(text))

"""Names of objects are valid, deterministic and never the same for two things."""

from __future__ import annotations

import re

from hypothesis import given, settings
from hypothesis import strategies as st

from fleet_operator.resources import names
from fleet_operator.resources.roles import Role

FLEET = st.from_regex(r"[a-z0-9]([-a-z0-9]{0,38}[a-z0-9])?", fullmatch=True)
AWKWARD = st.sampled_from(
    ["a", "a-m0001-sensor-b", "a-train", "a-m0001-weigh", "2018", "a-m0001-sensor", "b-m0001-sensor-c"]
)
PART = FLEET | AWKWARD
MISSION = st.integers(1, 10_000)
ROLES = st.sampled_from([Role.SENSOR, Role.WORKFLOW, Role.AGGREGATOR])
THING = (
    st.tuples(st.just("job"), PART, MISSION, ROLES, PART)
    | st.tuples(st.just("train"), PART)
    | st.tuples(st.just("weigh"), PART, MISSION)
    | st.tuples(st.just("functions"), PART, st.from_regex(r"[0-9a-f]{8}", fullmatch=True))
)


def name_of(thing: tuple) -> str:  # type: ignore[type-arg]  # the four kinds of things have different lengths
    match thing:
        case ("job", fleet, mission, role, member):
            return names.mission_job(role, fleet, mission, member)
        case ("train", fleet):
            return names.training_job(fleet)
        case ("weigh", fleet, mission):
            return names.weighing_job(fleet, mission)
        case (_, fleet, digest):
            return names.functions(fleet, digest)
    raise AssertionError(thing)


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


def test_a_long_name_keeps_its_beginning_and_ends_in_a_hash() -> None:
    name = names.mission_job(Role.SENSOR, "a" * 40, 1, "b" * 40)
    assert re.fullmatch("a{40}-m0001-sensor-[0-9a-f]{8}", name)


@given(st.text(min_size=1, max_size=80))
@settings(max_examples=100)
def test_every_label_value_is_one_that_kubernetes_takes(text: str) -> None:
    assert re.fullmatch(r"([A-Za-z0-9]([-A-Za-z0-9_.]{0,61}[A-Za-z0-9])?)?", names.label_value(text))

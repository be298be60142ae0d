"""What holds of every status, whatever happens: Kubernetes takes it, tools can read it, and it does not flutter."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml
from hypothesis import given
from hypothesis import strategies as st

from fleet.spec.base import Condition
from fleet.spec.resources import FleetStatus
from fleet_operator.policy.mission_status import mission_status
from fleet_operator.policy.status import Situation, fleet_status, status_manifest, status_of, story
from fleet_operator.resources.conditions import FleetCondition, MissionCondition
from tests.contract.api_server import refusals
from tests.kstatus import kstatus
from tests.situations import MISSIONS, SITUATIONS, situations

REASON = r"[A-Za-z]([A-Za-z0-9_,:]*[A-Za-z0-9_])?"
"""Kubernetes, metav1.Condition."""
LATER = "2030-01-01T00:00:00Z"


def schema(plural: str) -> dict[str, Any]:
    crd = yaml.safe_load((Path(__file__).parents[2] / "crds" / f"{plural}.yaml").read_text(encoding="utf-8"))
    found: dict[str, Any] = crd["spec"]["versions"][0]["schema"]["openAPIV3Schema"]["properties"]["status"]
    return found


FLEETS, MISSION_SCHEMA = schema("fleetspecs"), schema("missions")
HISTORY = st.lists(situations(), min_size=1, max_size=4)


def after(history: list[Situation]) -> FleetStatus | None:
    status = None
    for situation in history:
        status = fleet_status(situation, status)
    return status


@given(HISTORY)
def test_kubernetes_takes_every_status(history: list[Situation]) -> None:
    status = after(history)
    assert status is not None
    assert refusals(FLEETS, status_manifest(status)) == []
    assert [each.type for each in status.conditions] == list(FleetCondition)
    for each in status.conditions:
        assert re.fullmatch(REASON, each.reason)
        assert each.observed_generation == status.observed_generation == history[-1].generation
        assert len(each.message) <= 1024


@given(HISTORY)
def test_looking_again_changes_nothing_and_tells_nothing(history: list[Situation]) -> None:
    status = after(history)
    again = fleet_status(replace(history[-1], now=LATER), status)
    assert again == status
    assert story(status, again) == ()


@given(HISTORY, situations())
def test_the_time_of_a_condition_moves_with_its_status_only(history: list[Situation], next_one: Situation) -> None:
    before = after(history)
    assert before is not None
    now = fleet_status(next_one, before)
    old: dict[str, Condition] = {each.type: each for each in before.conditions}
    for each in now.conditions:
        changed = each.status != old[each.type].status
        assert each.last_transition_time == (next_one.now if changed else old[each.type].last_transition_time)


@given(HISTORY)
def test_ready_reconciling_and_stalled_fit_together(history: list[Situation]) -> None:
    status = after(history)
    assert status is not None
    says = {each.type: each.status for each in status.conditions}
    assert [says[kind] for kind in ("Ready", "Reconciling", "Stalled")].count("True") <= 1
    tools = kstatus({"metadata": {"generation": status.observed_generation}, "status": status_manifest(status)})
    match says:
        case {"Stalled": "True"}:
            assert tools == "Failed"
        case {"Ready": "True"}:
            assert tools == "Current"
        case _:
            assert tools == "InProgress"


@given(HISTORY)
def test_an_older_status_is_read_as_in_progress(history: list[Situation]) -> None:
    status = after(history)
    assert status is not None
    newer = {"metadata": {"generation": status.observed_generation + 1}, "status": status_manifest(status)}
    assert kstatus(newer) == "InProgress"


@given(HISTORY)
def test_a_status_is_read_back_as_it_was_written(history: list[Situation]) -> None:
    status = after(history)
    assert status is not None
    assert status_of({"status": status_manifest(status)}) == status


@given(HISTORY, situations())
def test_every_event_is_one_that_kubernetes_takes(history: list[Situation], next_one: Situation) -> None:
    before = after(history)
    for kind, reason, message in story(before, fleet_status(next_one, before)):
        assert kind in ("Normal", "Warning")
        assert re.fullmatch(REASON, reason)
        assert len(message) <= 1024


def test_what_could_not_be_observed_stays_as_it_was() -> None:
    flying = fleet_status(SITUATIONS["flying the second mission"], None)
    blind = fleet_status(SITUATIONS["the storage does not answer at first"], flying)
    changed = {each.type for each in blind.conditions if each not in flying.conditions}
    assert changed == {"Degraded"}
    assert blind.phase == "Flying"


def test_a_status_of_another_version_counts_as_none() -> None:
    assert status_of({"status": {"phase": 1}}) is None
    assert status_of({}) is None


@given(st.lists(st.sampled_from(sorted(MISSIONS)), min_size=1, max_size=4))
def test_the_same_holds_of_missions(history: list[str]) -> None:
    status = None
    for name in history:
        status = mission_status(MISSIONS[name], status)
    assert status is not None
    assert refusals(MISSION_SCHEMA, status_manifest(status)) == []
    assert [each.type for each in status.conditions] == list(MissionCondition)
    assert mission_status(replace(MISSIONS[history[-1]], now=LATER), status) == status
    tools = kstatus({"metadata": {"generation": 1}, "status": status_manifest(status)})
    assert tools == {"Succeeded": "Current", "Failed": "Failed"}.get(status.phase, "InProgress")

"""The events that changes of a fleet's status are worth tell its story, each thing once."""

from __future__ import annotations

from dataclasses import replace

from fleet_operator.policy.status import Situation, fleet_status, story
from tests.situations import AGENT, BROKEN, FILES, IMAGE, INVALID, SITUATIONS

GOALS = "accuracy 0.8 (at least 0.7: met), time_s 500 (at most 600: met)"


def told(*situations: Situation) -> list[str]:
    """Type and reason of every event, with what it says of missions."""
    status, found = None, []
    for situation in situations:
        before, status = status, fleet_status(situation, status)
        found += [f"{kind} {reason}: {message}" for kind, reason, message in story(before, status)]
    return found


def life(*names: str) -> list[str]:
    return told(*(SITUATIONS[name] for name in names))


def test_a_fleet_without_trouble() -> None:
    assert life(
        "nothing was observed yet",
        "preparing",
        "shaping",
        "training",
        "ordering the first mission",
        "flying",
        "flying, one has landed",
        "all have landed",
        "retraining",
        "weighing",
        "waiting",
        "flying the second mission",
        "done",
    ) == [
        "Normal Compiled: the FleetSpec is valid, and all that it names is there",
        "Normal Training: the trainer is shaping the reward",
        "Normal Shaped: the reward is in storage",
        "Normal Trained: the first model is in storage",
        "Normal MissionOrdered: mission 1 is ordered",
        f"Normal GoalsMet: mission 1: {GOALS}",
        "Normal Retraining: mission 1: 1 of 3 aggregators have reported",
        "Normal Weighing: mission 1: the models are being weighed",
        "Normal Waiting: mission 2 starts at 2026-08-01T06:01:00Z",
        "Normal MissionOrdered: mission 2 is ordered",
        "Normal GoalsMet: mission 3: accuracy 0.9 (at least 0.7: met), time_s 500 (at most 600: met)",
        "Normal MissionOrdered: mission 3 is ordered",
        "Normal Done: 3 missions were flown",
    ]


def test_a_refusal_and_its_end() -> None:
    assert life("files are missing", "files are missing", "preparing") == [
        f"Warning FilesMissing: {FILES.message}",
        "Normal Compiled: the FleetSpec is valid, and all that it names is there",
    ]


def test_trouble_is_told_once_and_its_end_too() -> None:
    flying = SITUATIONS["flying"]
    troubled = replace(flying, troubles=(AGENT,))
    assert told(flying, troubled, troubled, flying)[-2:] == [
        f"Warning AgentFailed: {AGENT.message}",
        f"Normal Recovered: no longer: {AGENT.message}",
    ]


def test_what_stalls_a_fleet_is_not_told_twice() -> None:
    assert life("shaping", "the image of the trainer is missing")[2:] == [f"Warning ImageMissing: {IMAGE.message}"]
    assert life("shaping", "the trainer is broken")[2:] == [f"Warning Stalled: {BROKEN}"]
    assert life("the FleetSpec is invalid") == [f"Warning Invalid: {INVALID.message}"]


def test_what_stalls_a_fleet_later_than_it_was_first_told_is_told_then() -> None:
    flying, invalid = "the FleetSpec is invalid in flight", "the FleetSpec is invalid"
    assert life("flying the second mission", flying, invalid)[-2:] == [
        f"Warning Invalid: {INVALID.message}",
        f"Warning Stalled: {INVALID.message}",
    ]


def test_suspend_and_resume() -> None:
    assert life("waiting", "suspended", "flying the second mission")[-3:] == [
        "Normal Suspended: mission 2 is flown when spec.suspend is false again",
        "Normal MissionOrdered: mission 2 is ordered",
        "Normal Resumed: spec.suspend is false again",
    ]

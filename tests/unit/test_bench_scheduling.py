"""What the benchmark of scheduling reads from Jobs and pods."""

from __future__ import annotations

from typing import Any

from bench.scheduling import LEVELS, by_level
from bench.scheduling_bed.cluster import Run
from bench.scheduling_bed.lives import Life, Observed


def _job(subset: str, created: str) -> dict[str, Any]:
    annotations = {"fleetcomputer.io/subset": subset}
    return {"metadata": {"uid": f"job-{subset}", "creationTimestamp": created, "annotations": annotations}}


def _pod(uid: str, job: str, **state: Any) -> dict[str, Any]:
    statuses = [{"name": "aggregator", "state": state}] if state else []
    owners = [{"kind": "Job", "uid": job}]
    return {"metadata": {"uid": uid, "ownerReferences": owners}, "status": {"containerStatuses": statuses}}


def _at(second: int) -> str:
    return f"2026-01-01T00:00:{second:02d}Z"


def test_a_preempted_aggregator_waits_until_its_first_pod_and_lives_until_its_last_is_done() -> None:
    observed = Observed()
    observed.add([_pod("a", "job-1")])
    observed.add([_pod("a", "job-1", running={"startedAt": _at(3)})])
    observed.add([_pod("b", "job-1")])  # the first is gone
    done = {"startedAt": _at(20), "finishedAt": _at(29), "exitCode": 0}
    observed.add([_pod("b", "job-1", terminated=done), _pod("c", "job-2", running={"startedAt": _at(5)})])
    jobs = [_job("1", _at(1)), _job("2", _at(1)), _job("1-2", _at(1))]
    assert observed.lives(jobs) == [Life("1", waiting_s=2.0, lifetime_s=26.0, pods=2)]


def test_a_container_that_failed_is_no_end() -> None:
    observed = Observed()
    observed.add([_pod("a", "job-1", terminated={"startedAt": _at(3), "finishedAt": _at(9), "exitCode": 143})])
    assert observed.lives([_job("1", _at(1))]) == []


def test_each_level_is_held_against_the_peer_and_against_being_alone() -> None:
    levels = {"1": 9, "2": 1, "1-2": 0}
    loaded = Run({"1": Life("1", 1, 12, 1), "2": Life("2", 20, 10, 1)}, preempted=1)
    peer = Run({"1": Life("1", 30, 10, 1), "2": Life("2", 0, 10, 1), "1-2": Life("1-2", 9, 10, 1)}, preempted=0)
    alone = {"1": Life("1", 1, 10, 1), "2": Life("2", 1, 10, 1)}
    found = {each.name.removeprefix("scheduling, "): each for each in by_level(loaded, peer, alone, levels)}
    assert {name: (each.value, each.peer_value, each.ratio) for name, each in found.items()} == {
        "level 9, waiting": (1, 30, 1 / 30),
        "level 9, lifetime": (12, 10, 1.2),
        "level 9, lifetime / lifetime alone": (1.2, 1.0, 1.2),
        "level 1, waiting": (20, 0, None),
        "level 1, lifetime": (10, 10, 1.0),
        "level 1, lifetime / lifetime alone": (1.0, 1.0, 1.0),
        "levels 8 and 9, longest waiting": (1, 30, 1 / 30),
        "levels 8 and 9, largest lifetime / lifetime alone": (1.2, 1.0, 1.2),
        "levels 1 and 2, waiting / lifetime alone": (2.0, 0.0, None),
        "until a model is there, weighted by its level": (14.7, 37.0, 14.7 / 37),
        "until all models are there": (30, 40, 0.75),
    }


def test_every_level_is_there_and_the_subsets_of_four_agents_have_one_each() -> None:
    assert len(LEVELS) == 15
    assert set(LEVELS) == set(range(10))

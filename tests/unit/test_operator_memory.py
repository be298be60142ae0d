"""What the operator remembers of the cluster, whoever brings the news and in whatever order."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet_operator.cluster.memory import Listeners, Memory, unpacked
from fleet_operator.cluster.shelves import FILES, FLEETS, JOBS, MISSIONS, NODES
from fleet_operator.cluster.store import Store
from fleet_operator.resources import names
from fleet_operator.resources.refs import CONFIG_MAP, FLEET_SPEC, JOB, MISSION, Kind, Manifest, ObjectRef
from fleet_operator.resources.views import JobState

CROP = ObjectRef("farm", "crop")


class Ears:
    """Everything that the memory tells."""

    def __init__(self, memory: Memory) -> None:
        self.told: list[object] = []
        memory.listeners = Listeners(
            self.told.append, lambda ref, last: self.told.append((ref, last["metadata"]["uid"]))
        )


@pytest.fixture
def memory() -> Memory:
    return Memory()


@pytest.fixture
def ears(memory: Memory) -> Ears:
    return Ears(memory)


def body(kind: Kind, name: str, version: int, uid: str = "u1", **rest: Any) -> Manifest:
    metadata = {"name": name, "namespace": "farm", "uid": uid, "resourceVersion": str(version)}
    metadata |= rest.pop("metadata", {})
    return {"apiVersion": kind.api_version, "kind": kind.kind, "metadata": metadata, **rest}


def fleet(version: int, uid: str = "u1", generation: int = 1, **rest: Any) -> Manifest:
    return body(FLEET_SPEC, "crop", version, uid, metadata={"generation": generation}, **rest)


def job(version: int, name: str = "crop-train", uid: str = "j1", **status: Any) -> Manifest:
    return body(JOB, name, version, uid, metadata={"labels": {names.FLEET_LABEL: "crop"}}, spec={}, status=status)


def test_a_new_fleet_is_told_and_an_older_version_of_it_is_not(memory: Memory, ears: Ears) -> None:
    memory.put(FLEETS, fleet(5, generation=2))
    memory.put(FLEETS, fleet(4, generation=1))
    assert ears.told == [CROP]
    entry = memory.fleets.get(CROP)
    assert entry is not None
    assert entry.view == fleet(5, generation=2)


def test_managed_fields_are_not_kept(memory: Memory) -> None:
    whole = fleet(5)
    whole["metadata"]["managedFields"] = [{"manager": "kubectl"}]
    memory.put(FLEETS, whole)
    entry = memory.fleets.get(CROP)
    assert entry is not None
    assert entry.view == fleet(5)


def test_an_own_status_is_not_told_whoever_brings_it_first(memory: Memory, ears: Ears) -> None:
    memory.put(FLEETS, fleet(5))
    memory.put(FLEETS, fleet(6, status={"phase": "Training"}))
    memory.put(FLEETS, fleet(6, status={"phase": "Training"}))
    assert ears.told == [CROP]


def test_a_change_of_another_that_an_own_write_has_overtaken_is_told(memory: Memory, ears: Ears) -> None:
    memory.put(FLEETS, fleet(5))
    memory.put(FLEETS, fleet(7, generation=2, status={"phase": "Training"}))  # the answer to an own write
    memory.put(FLEETS, fleet(6, generation=2))  # the watch is late
    assert ears.told == [CROP, CROP]


def test_a_fleet_made_anew_under_its_name_is_one_that_went_and_one_that_came(memory: Memory, ears: Ears) -> None:
    memory.put(FLEETS, fleet(5))
    memory.put(FLEETS, fleet(9, uid="u2"))
    memory.drop(FLEETS, fleet(8))  # the deletion of the first comes last
    assert ears.told == [CROP, (CROP, "u1"), CROP]
    assert [entry.uid for ref in memory.fleets if (entry := memory.fleets.get(ref))] == ["u2"]


def test_jobs_are_told_when_their_state_changes_and_not_for_anything_else(memory: Memory, ears: Ears) -> None:
    memory.put(JOBS, job(1))  # made by the operator itself
    memory.put(JOBS, job(2, active=1))
    memory.put(JOBS, job(3, active=1, ready=1))
    memory.put(JOBS, job(4, active=1, ready=1, startTime="now"))
    memory.put(JOBS, job(5, conditions=[{"type": "Complete", "status": "True"}]))
    assert ears.told == [CROP, CROP]
    assert [view.state for view in memory.jobs.owned_by(CROP)] == [JobState.SUCCEEDED]


def test_a_job_that_is_over_when_it_is_first_seen_is_told(memory: Memory, ears: Ears) -> None:
    memory.put(JOBS, job(5, conditions=[{"type": "Failed", "status": "True", "reason": "BackoffLimitExceeded"}]))
    assert ears.told == [CROP]


def test_an_acknowledged_deletion_is_gone_at_once_and_does_not_come_back_by_old_news(
    memory: Memory, ears: Ears
) -> None:
    memory.put(JOBS, job(5))
    memory.forget(JOB, ObjectRef("farm", "crop-train"), "other")
    assert len(memory.jobs) == 1
    memory.forget(JOB, ObjectRef("farm", "crop-train"), "j1")
    memory.put(JOBS, job(4, ready=1))
    memory.drop(JOBS, job(6))
    assert len(memory.jobs) == 0
    assert ears.told == [CROP]


def test_a_list_removes_what_vanished_and_leaves_what_is_newer_than_the_list(memory: Memory, ears: Ears) -> None:
    for name, version in (("a", 1), ("b", 2), ("c", 9)):
        memory.put(JOBS, job(version, name, uid=name))
    memory.replace(JOBS, [ObjectRef("farm", "a")], version=5, namespace="")
    assert [view.ref.name for view in memory.jobs.owned_by(CROP)] == ["a", "c"]
    assert ears.told == [CROP]


def test_a_list_of_one_namespace_says_nothing_of_others(memory: Memory) -> None:
    memory.put(JOBS, job(1))
    memory.replace(JOBS, [], version=5, namespace="elsewhere")
    assert len(memory.jobs) == 1


def test_after_the_history_was_put_back_old_versions_count_again(memory: Memory) -> None:
    memory.put(FLEETS, fleet(100, generation=3))
    memory.fleets.put_back(50)
    memory.put(FLEETS, fleet(40, generation=2))
    memory.replace(FLEETS, [CROP], version=50, namespace="")
    entry = memory.fleets.get(CROP)
    assert entry is not None
    assert (entry.version, entry.view["metadata"]["generation"]) == (40, 2)


def test_files_are_told_to_the_fleet_that_their_label_names(memory: Memory, ears: Ears) -> None:
    files = body(CONFIG_MAP, "crop-files-0", 3, metadata={"labels": {names.FILES_LABEL: "crop"}}, data={"a": "b"})
    memory.put(FILES, files)
    assert ears.told == [CROP]
    assert [unpacked(packed) for packed in memory.files.owned_by(CROP)] == [files]


def test_missions_and_machines_are_remembered_and_not_told(memory: Memory, ears: Ears) -> None:
    owner = {"apiVersion": FLEET_SPEC.api_version, "kind": "FleetSpec", "name": "crop", "uid": "u1"}
    memory.put(MISSIONS, body(MISSION, "crop-m0001", 3, metadata={"ownerReferences": [owner]}, spec={"number": 1}))
    memory.put(NODES, {"metadata": {"name": "edge1", "resourceVersion": "4"}, "status": {}})
    assert ears.told == []
    assert [len(memory.missions.owned_by(CROP)), len(memory.nodes)] == [1, 1]


VERSIONS = st.permutations(range(1, 9))


@given(order=VERSIONS, deletions=st.sets(st.integers(1, 8)))
def test_the_newest_news_wins_in_any_order(order: list[int], deletions: set[int]) -> None:
    store: Store[int] = Store(lambda one: int(one["metadata"]["resourceVersion"]), lambda one: CROP)
    for version in order:
        one = {"metadata": {"name": "a", "namespace": "n", "resourceVersion": str(version)}}
        if version in deletions:
            store.drop(one)
        else:
            store.put(one)
    assert store.views() == store.owned_by(CROP) == ([] if 8 in deletions else [8])

"""Whose data is in storage: claims, deletion by policy, and a FleetSpec that is made again."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from fleet.storage.layout import CLAIMS
from fleet_operator.flow.stored import read_spec
from fleet_operator.reconcile.claiming import data_uri
from fleet_operator.resources.refs import FLEET_SPEC
from tests.reconciled import PATHS, REF, Reconciled

DELETE = {"storage": {"onDelete": "Delete"}}


@pytest.fixture
def run(tmp_path: Path, quick_disk: None) -> Reconciled:
    return Reconciled(tmp_path)


@pytest.mark.parametrize(("policy", "kept"), [({}, True), (DELETE, False)])
def test_the_data_of_a_deleted_fleet_goes_or_stays_as_its_fleetspec_says(
    run: Reconciled, policy: dict[str, object], kept: bool
) -> None:
    run.ask(**policy)
    run.settle(until="Flying")
    last = run.delete()
    assert run.cluster.objects == {}
    run.look()
    assert run.later is None
    asyncio.run(run.reconciler.forget(REF, last))
    assert (run.has_data(), run.claims()) == (kept, [])
    assert run.cluster.objects == {}


@pytest.mark.parametrize(("policy", "kept"), [({}, True), (DELETE, False)])
def test_what_was_deleted_while_nobody_looked_is_found_at_the_next_start(
    run: Reconciled, policy: dict[str, object], kept: bool
) -> None:
    run.ask(**policy)
    run.settle()
    run.delete()
    run.restart()
    asyncio.run(run.reconciler.sweep({}))
    assert (run.has_data(), run.claims()) == (kept, [])


def test_a_sweep_touches_no_fleet_that_is_there(run: Reconciled) -> None:
    run.ask(**DELETE)
    run.settle(until="Flying")
    uid = run.body["metadata"]["uid"]
    asyncio.run(run.reconciler.sweep({REF: uid}))
    assert (run.has_data(), run.claims()) == (True, [uid])


def test_fleets_of_another_operators_namespaces_are_none_of_its_business(run: Reconciled) -> None:
    run.ask(**DELETE)
    run.settle(until="Flying")
    run.restart(namespaces=("elsewhere",))
    asyncio.run(run.reconciler.sweep({}))
    assert run.has_data()


def test_a_policy_that_changes_at_rest_counts(run: Reconciled) -> None:
    run.ask()
    run.settle()
    run.ask(**DELETE)
    run.restart()
    run.settle()
    asyncio.run(run.reconciler.forget(REF, run.delete()))
    assert not run.has_data()


def test_a_fleetspec_that_is_made_again_goes_on_from_the_data(run: Reconciled) -> None:
    run.ask(missions={"count": 1})
    run.settle()
    asyncio.run(run.reconciler.forget(REF, run.delete()))
    run.ask(missions={"count": 2})
    assert run.settle() == ["Flying", "Retraining", "Weighing", "Done"]
    assert run.status["missions"] == "2/2"
    assert [reason for _, reason, _ in run.cluster.events].count("Adopted") == 1


def test_a_mission_that_was_under_way_is_gone_on_with(run: Reconciled) -> None:
    run.ask(missions={"count": 1})
    run.settle(until="Weighing")
    run.delete()
    run.ask(missions={"count": 1})
    assert run.settle() == ["Weighing", "Done"]
    assert run.claims() == [run.body["metadata"]["uid"]]


def test_data_of_a_fleet_with_other_agents_is_left_alone(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Flying")
    last = run.delete()
    run.ask(agents={"count": 3})
    run.look()
    assert (run.later, run.conditions()["Compiled"]) == (60.0, ("False", "StorageTaken"))
    assert run.conditions()["Stalled"] == ("True", "StorageTaken")
    assert "other agents" in run.message("Compiled")
    spec = read_spec(run.storage, PATHS)
    assert spec is not None
    assert spec.metadata.uid == last["metadata"]["uid"]
    assert run.names("Job") == []


def test_data_that_its_owner_wanted_deleted_is_not_adopted(run: Reconciled) -> None:
    run.ask(**DELETE)
    run.settle(until="Flying")
    last = run.delete()
    run.ask(agents={"count": 3})
    run.settle(until="Training")
    asyncio.run(run.reconciler.forget(REF, last))
    assert run.claims() == [run.body["metadata"]["uid"]]
    assert run.settle()[-1] == "Done"


def test_jobs_of_an_earlier_fleetspec_go_before_anything_is_made(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Flying")
    left = {key: body for key, body in run.cluster.objects.items() if key[0] == "Job"}
    run.delete()
    run.cluster.objects |= left
    run.ask()
    run.look()
    assert (run.later, run.names("Job"), run.phase) == (1.0, [], "Pending")
    assert run.settle()[-1] == "Done"


def test_a_pass_that_finds_the_fleetspec_gone_makes_nothing(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Training")

    def delete_first(name: str) -> None:
        run.cluster.before_call = lambda name: None
        run.delete()

    run.cluster.run_jobs()
    run.cluster.before_call = delete_first
    run.look()
    assert {kind for kind, _ in run.cluster.objects} <= {"Mission"}  # the call that was on its way
    assert run.later is None


def test_what_is_no_claim_is_left_alone(run: Reconciled) -> None:
    run.storage.write(f"{CLAIMS}/default.plots.json", b'{"namespace": "default", "root": ""}')
    run.storage.write("default/plots/fleet.json", b"{}")
    asyncio.run(run.reconciler.sweep({}))
    assert run.has_data()


def test_a_fleetspec_that_is_on_its_way_out_is_left_alone(run: Reconciled) -> None:
    run.ask()
    run.cluster.objects[FLEET_SPEC.kind, REF]["metadata"]["deletionTimestamp"] = "2026-01-01T00:00:00Z"
    run.look()
    assert (run.later, run.cluster.calls, run.storage_calls) == (None, [], [])


@pytest.mark.parametrize(
    ("storage", "expected"),
    [
        ("file:///fleet", "file:///fleet/farm/plots"),
        ("webhdfs://fleet@name:9870/fleet/?replication=3", "webhdfs://fleet@name:9870/fleet/farm/plots?replication=3"),
    ],
)
def test_the_address_of_a_fleets_data_keeps_what_the_storages_asks_for(storage: str, expected: str) -> None:
    assert data_uri(storage, "farm/plots") == expected

"""Clusters that share a storage: an operator takes and deletes only what is surely its own."""

from __future__ import annotations

import asyncio
import json
import logging
from pathlib import Path

import pytest

from fleet.errors import StorageUnavailable
from fleet.storage.layout import CLAIMS
from fleet_operator.flow.claims import Claim, all_claims, read_claim, write_claim
from tests.reconciled import PATHS, REF, Reconciled

DELETE = {"storage": {"onDelete": "Delete"}}


@pytest.fixture
def run(tmp_path: Path, quick_disk: None) -> Reconciled:
    return Reconciled(tmp_path)


def everything(run: Reconciled) -> dict[str, bytes]:
    return {entry.path: run.storage.read(entry.path) for entry in run.storage.list("")}


def claim(run: Reconciled) -> Claim:
    found = read_claim(run.storage, PATHS)
    assert found is not None
    return found


def without_installation(run: Reconciled) -> None:
    """The claim as it was written before claims said whose they are."""
    document = json.loads(run.storage.read(PATHS.claim))
    del document["installation"]
    run.storage.write(PATHS.claim, json.dumps(document).encode())


@pytest.mark.parametrize("installation", ["there", ""])
def test_a_sweep_leaves_alone_what_another_cluster_may_use(run: Reconciled, installation: str) -> None:
    run.ask(**DELETE)
    run.settle(until="Flying")
    run.restart(installation=installation)
    asyncio.run(run.reconciler.sweep({}))
    assert (run.has_data(), run.claims()) == (True, [run.body["metadata"]["uid"]])


@pytest.mark.parametrize("installation", ["here", ""])
def test_a_sweep_leaves_alone_what_does_not_say_whose_it_is(run: Reconciled, installation: str) -> None:
    run.ask(**DELETE)
    run.settle(until="Flying")
    without_installation(run)
    run.delete()
    run.restart(installation=installation)
    asyncio.run(run.reconciler.sweep({}))
    assert (run.has_data(), len(run.claims())) == (True, 1)


@pytest.mark.parametrize("before", ["there", ""])
def test_a_sweep_makes_claims_of_living_fleets_this_installations(run: Reconciled, before: str) -> None:
    run.ask()
    run.settle(until="Flying")
    if before:
        write_claim(run.storage, claim(run).model_copy(update={"installation": before}))
    else:
        without_installation(run)
    run.restart()
    asyncio.run(run.reconciler.sweep({REF: run.body["metadata"]["uid"]}))
    assert claim(run).installation == "here"


def test_a_living_fleet_makes_its_claim_this_installations(run: Reconciled) -> None:
    run.ask(**DELETE)
    run.settle(until="Flying")
    without_installation(run)
    run.restart()
    run.look()
    assert claim(run).installation == "here"


@pytest.mark.parametrize("unknown", [False, True])
def test_a_fleetspec_of_the_same_name_in_another_cluster_is_refused_and_takes_nothing(
    run: Reconciled, tmp_path: Path, unknown: bool
) -> None:
    run.ask(**DELETE)
    run.settle(until="Flying")
    if unknown:
        without_installation(run)
    before = everything(run)
    there = Reconciled(tmp_path)
    there.cluster.made = 1000  # a uid is of one object in all the world
    there.restart(installation="there")
    there.ask(**DELETE)
    there.look()
    assert (there.later, there.conditions()["Compiled"]) == (60.0, ("False", "StorageTaken"))
    assert f"belongs to the FleetSpec {claim(run).uid} of " in there.message("Compiled")
    assert "delete _claims/default.plots.json in file://" in there.message("Compiled")
    assert there.names("Job") == []
    asyncio.run(there.reconciler.forget(REF, there.delete()))
    assert everything(run) == before
    assert run.settle()[-1] == "Done"


def test_when_the_other_cluster_is_gone_for_good_its_claim_can_be_taken_away(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Flying")
    run.delete()
    run.restart(installation="there")
    run.ask()
    run.look()
    assert run.conditions()["Compiled"] == ("False", "StorageTaken")
    run.storage.delete(PATHS.claim)
    assert run.settle()[-1] == "Done"
    assert "Adopted" in [reason for _, reason, _ in run.cluster.events]


def test_who_has_seen_a_fleetspec_go_settles_its_claim_though_that_does_not_say_whose_it_is(run: Reconciled) -> None:
    run.ask(**DELETE)
    run.settle(until="Flying")
    without_installation(run)
    asyncio.run(run.reconciler.forget(REF, run.delete()))
    assert (run.has_data(), run.claims()) == (False, [])


def test_a_claim_in_anothers_place_counts_for_nothing(run: Reconciled) -> None:
    run.ask(**DELETE)
    run.settle(until="Flying")
    run.storage.write("default/victim/fleet.json", b"{}")
    false = claim(run).model_copy(update={"fleet": "victim", "root": "default/victim", "uid": "gone"})
    for name in ("false", "plots"):
        run.storage.write(f"{CLAIMS}/default.{name}.json", false.model_dump_json(by_alias=True).encode())
    asyncio.run(run.reconciler.sweep({REF: run.body["metadata"]["uid"]}))
    asyncio.run(run.reconciler.forget(REF, run.delete()))
    assert run.storage.exists("default/victim/fleet.json")


def test_a_claim_that_cannot_be_settled_holds_up_no_other(run: Reconciled, caplog: pytest.LogCaptureFixture) -> None:
    run.ask(**DELETE)
    run.settle(until="Training")
    for name in ("a", "z"):
        write_claim(run.storage, claim(run).model_copy(update={"fleet": name, "root": f"default/{name}"}))
        run.storage.write(f"default/{name}/fleet.json", b"{}")
    run.delete()

    def refuse(call: str) -> None:
        if call == "delete default/a":
            raise StorageUnavailable("no DataNode answers")

    run.before_storage = refuse
    with caplog.at_level(logging.WARNING):
        asyncio.run(run.reconciler.sweep({}))
    assert [each.fleet for each in all_claims(run.storage)] == ["a"]
    assert "default/a is gone, and its data cannot be seen to yet: no DataNode answers" in caplog.text
    run.before_storage = lambda call: None
    asyncio.run(run.reconciler.sweep({}))
    assert run.claims() == []


def test_a_claim_to_what_is_out_of_reach_holds_up_no_other(run: Reconciled) -> None:
    run.ask(**DELETE)
    run.settle(until="Training")
    stray = {"fleet": "a", "root": "default/a", "uri": "webhdfs://fleet@elsewhere:9870/fleet"}
    write_claim(run.storage, claim(run).model_copy(update=stray))
    run.delete()
    run.restart(hosts=("namenode",))
    asyncio.run(run.reconciler.sweep({}))
    assert [each.fleet for each in all_claims(run.storage)] == ["a"]


def test_a_sweep_does_nothing_to_a_fleet_that_is_made_again_meanwhile(run: Reconciled) -> None:
    run.ask(**DELETE)
    run.settle(until="Training")
    run.delete()

    async def sweep_and_pass() -> None:
        sweeping = asyncio.create_task(run.reconciler.sweep({}))
        run.ask(**DELETE)
        await asyncio.gather(sweeping, run.reconciler.reconcile(REF))

    asyncio.run(sweep_and_pass())
    assert run.claims() == [run.body["metadata"]["uid"]]
    assert run.settle()[-1] == "Done"

"""The life of a fleet in a cluster: its steps, what the user may change meanwhile, and rest."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from fleet.errors import StorageUnavailable
from fleet.missions.documents import MissionOrder, WeightsDocument
from fleet_operator.flow.stored import read_spec
from fleet_operator.resources.refs import JOB, MISSION, ObjectRef
from tests.fleet_runs import FUNCTIONS
from tests.memory_cluster import Broken
from tests.reconciled import PATHS, REF, Reconciled

A_MISSION = ["Flying", "Retraining", "Weighing"]


@pytest.fixture
def run(tmp_path: Path, quick_disk: None) -> Reconciled:
    return Reconciled(tmp_path)


def jobs(run: Reconciled) -> list[str]:
    return [name.removeprefix("plots-") for name in run.names("Job")]


def order_of(run: Reconciled, number: int) -> MissionOrder:
    return MissionOrder.model_validate_json(run.storage.read(PATHS.plan(number)))


def test_a_fleet_flies_its_missions_and_comes_to_rest(run: Reconciled) -> None:
    run.ask()
    assert run.settle() == ["Training", *A_MISSION, *A_MISSION, "Done"]
    assert run.conditions() == {
        "Ready": ("True", "Done"),
        "Reconciling": ("False", "Done"),
        "Compiled": ("True", "Compiled"),
        "Shaped": ("True", "Shaped"),
        "Trained": ("True", "Trained"),
        "Flying": ("False", "Done"),
        "GoalsMet": ("True", "GoalsMet"),
        "Degraded": ("False", "NoTrouble"),
        "Stalled": ("False", "GoesOn"),
    }
    missions = run.cluster.missions(REF)
    assert [(number, body["status"]["phase"]) for number, body in missions.items()] == [
        (1, "Succeeded"),
        (2, "Succeeded"),
    ]
    flight = ["aggregator-1", "aggregator-1-2", "aggregator-2", "sensor-agent-1", "sensor-agent-2", "weigh"]
    flight += ["workflow-agent-1", "workflow-agent-2"]
    assert jobs(run) == [f"m{number:04d}-{job}" for number in (1, 2) for job in flight]
    owners = {
        body["metadata"]["ownerReferences"][0]["uid"]
        for (kind, _), body in run.cluster.objects.items()
        if kind != "FleetSpec"
    }
    assert owners == {run.body["metadata"]["uid"]}


def test_a_fleet_at_rest_costs_nothing_not_even_a_new_operator(run: Reconciled) -> None:
    run.ask()
    run.settle()
    for again in (False, True):
        if again:
            run.restart()
        calls, stored = len(run.cluster.calls), len(run.storage_calls)
        run.look()
        assert run.later is None
        assert (run.cluster.calls[calls:], run.storage_calls[stored:]) == ([], [])


def test_jobs_of_missions_before_the_last_two_are_deleted_with_their_services(run: Reconciled) -> None:
    run.ask(missions={"count": 3})
    run.settle()
    assert {name[:5] for name in jobs(run)} == {"m0002", "m0003"}
    assert {name[:11] for name in run.names("Service")} == {"plots-m0002", "plots-m0003"}
    assert len(run.names("Mission")) == 3


def test_a_service_goes_before_the_job_that_tells_of_it(run: Reconciled) -> None:
    run.ask(missions={"count": 3})

    def kill(name: str) -> None:
        if name.startswith("delete Service"):
            run.cluster.before_call = lambda name: None
            raise Broken(name)

    run.cluster.before_call = kill
    with pytest.raises(Broken):
        run.settle()
    assert "plots-m0001-sensor-agent-1" in run.names("Job")
    run.restart()
    run.settle()
    assert {name[:11] for name in run.names("Service")} == {"plots-m0002", "plots-m0003"}


def test_a_job_of_somebody_else_with_the_fleets_label_is_left_alone(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Flying")
    labels = {"fleetcomputer.io/fleet": REF.name, "fleetcomputer.io/role": "Sensor", "fleetcomputer.io/mission": "0"}
    mine = {"apiVersion": "batch/v1", "kind": "Job", "spec": {"suspend": True}}
    run.cluster.put(mine | {"metadata": {"name": "mine", "namespace": "default", "labels": labels}})
    run.settle()
    assert run.phase == "Done"
    assert "mine" in run.names("Job")


def test_jobs_that_were_orphaned_are_gone_on_with(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Flying")
    for name in run.names("Job"):
        del run.cluster.job(name)["metadata"]["ownerReferences"]
    before = {name: run.cluster.job(name)["metadata"]["uid"] for name in run.names("Job")}
    run.restart()
    run.look()
    assert {name: run.cluster.job(name)["metadata"]["uid"] for name in run.names("Job")} == before
    run.cluster.end_job("plots-m0001-workflow-agent-2", "it fell")
    run.look()
    assert run.storage.exists(PATHS.landing(1, "agent-2"))


def test_a_fleet_that_waits_for_long_keeps_little_in_memory(run: Reconciled) -> None:
    run.ask(missions={"count": 2, "interval": "1h"})
    run.settle(until="Waiting")
    (note,) = run.reconciler._notes.values()
    kept = (note.asked, note.functions, note.stored, note.known, note.documents, note.steps, note.situation)
    assert kept == (None, None, None, None, {}, {}, None)
    run.before_storage = away
    run.look()
    assert (run.phase, run.conditions()["Degraded"]) == ("Waiting", ("True", "StorageUnavailable"))


def away(name: str) -> None:
    raise StorageUnavailable("the NameNode does not answer")


def test_functions_that_change_again_before_the_first_mission_leave_nothing(run: Reconciled) -> None:
    run.ask()
    for number in range(4):
        (run.folder / "library" / "plots" / "own.py").write_text(f"{FUNCTIONS}\nEXTRA = {number % 3}\n")
        run.ask(training={"epochs": number + 1})
        run.settle(until="Training")
    assert len(run.names("ConfigMap")) == 2  # of the trainer that waits, and of the one before it
    run.settle()
    assert len(run.names("ConfigMap")) == 1


def test_more_missions_are_flown_when_the_user_asks_for_more(run: Reconciled) -> None:
    run.ask(missions={"count": 1})
    run.settle()
    run.ask(missions={"count": 2})
    assert run.settle() == [*A_MISSION, "Done"]
    assert run.status["missions"] == "2/2"


def test_a_suspended_fleet_ends_its_mission_and_waits(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Flying")
    run.ask(suspend=True)
    assert run.settle()[-1] == "Suspended"
    assert (run.status["missions"], run.conditions()["Ready"]) == ("1/2", ("True", "Suspended"))
    run.restart()
    run.ask(suspend=False)
    assert run.settle() == [*A_MISSION, "Done"]


def test_a_change_in_flight_takes_effect_at_the_next_mission(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Flying")
    before = run.names("ConfigMap")
    (run.folder / "library" / "plots" / "own.py").write_text(FUNCTIONS + "\nEXTRA = 1\n")
    run.ask(goals=[{"metric": "accuracy", "atLeast": 0.9}], missions={"count": 2, "seed": 7})
    run.restart()
    run.look()
    assert run.names("ConfigMap") == before
    assert run.status["observedGeneration"] == 2
    run.settle(until="Weighing")
    assert order_of(run, 1).seed == 0
    assert run.conditions()["GoalsMet"] == ("True", "GoalsMet")
    run.settle()
    assert order_of(run, 2).seed == 7
    assert run.conditions()["GoalsMet"] == ("False", "GoalsMissed")
    assert len(run.names("ConfigMap")) == 1
    assert run.names("ConfigMap") != before


def test_a_change_that_is_refused_in_flight_is_said_and_the_mission_goes_on(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Flying")
    run.ask(stateSpace={"context": "nowhere"})
    run.look()
    assert run.conditions()["Compiled"] == ("False", "Invalid")
    assert run.conditions()["Stalled"] == ("False", "GoesOn")
    assert run.settle()[-1] == "Refused"
    assert run.conditions()["Stalled"] == ("True", "Invalid")
    assert run.storage.exists(PATHS.weights(2))
    assert not run.storage.exists(PATHS.plan(2))
    run.ask()
    assert run.settle()[-1] == "Done"


def test_images_and_amounts_change_for_pods_that_could_not_start(run: Reconciled) -> None:
    run.ask(workflow={"resources": {"requests": {"cpu": "900"}, "limits": {"cpu": "900"}}})
    run.settle(until="Flying")
    run.cluster.start_job("plots-m0001-workflow-agent-1")
    uids = {name: run.cluster.job(name)["metadata"]["uid"] for name in run.names("Job")}
    run.ask()
    run.look()
    run.look()
    changed = {name for name in run.names("Job") if run.cluster.job(name)["metadata"]["uid"] != uids[name]}
    assert "plots-m0001-workflow-agent-1" not in changed
    assert "plots-m0001-workflow-agent-2" in changed
    main = run.cluster.job("plots-m0001-workflow-agent-2")["spec"]["template"]["spec"]["containers"][0]
    assert main["resources"]["limits"]["cpu"] == "1"


def test_the_next_mission_waits_for_its_time_whoever_runs_the_operator(run: Reconciled) -> None:
    run.ask(missions={"count": 2, "interval": "1h"})
    run.settle(until="Waiting")
    assert run.later == 3600.0
    started = run.status["nextMission"]
    run.cluster.clock.sleep(1800.0)
    run.restart()
    run.look()
    assert (run.later, run.status["nextMission"]) == (1800.0, started)
    run.cluster.clock.sleep(1800.0)
    assert run.settle() == [*A_MISSION, "Done"]


def wait_for_the_second_mission(run: Reconciled, missions: dict[str, Any]) -> None:
    run.ask(missions=missions)
    run.settle(until="Waiting")
    if "schedule" in missions:  # the first one waited for its time too
        run.cluster.clock.sleep(run.later or 0.0)
        run.settle(until="Waiting")


INTERVAL, SCHEDULE = {"count": 2, "interval": "1h"}, {"count": 2, "schedule": "0 * * * *"}


@pytest.mark.parametrize("missions", [INTERVAL, SCHEDULE])
def test_a_mission_that_somebody_deletes_is_made_again_and_the_next_one_starts_at_its_time(
    run: Reconciled, missions: dict[str, Any]
) -> None:
    wait_for_the_second_mission(run, missions)
    started, first = run.status["nextMission"], run.cluster.missions(REF)[1]
    for again in (False, True):
        run.cluster.clock.sleep(600.0)
        run.cluster.remove(MISSION, ObjectRef("default", "plots-m0001"))
        if again:
            run.restart()
        run.look()
        made = run.cluster.missions(REF)[1]
        assert (run.phase, run.status["nextMission"]) == ("Waiting", started)
        assert (made["spec"], made["status"]["phase"]) == (first["spec"], "Succeeded")
    run.cluster.clock.sleep(run.later or 0.0)
    assert run.settle() == [*A_MISSION, "Done"]


@pytest.mark.parametrize("missions", [INTERVAL, SCHEDULE])
def test_a_fleetspec_without_a_status_waits_for_its_next_mission_and_not_for_ever(
    run: Reconciled, missions: dict[str, Any]
) -> None:
    wait_for_the_second_mission(run, missions)
    asyncio.run(run.reconciler.forget(REF, run.delete()))
    run.ask(missions=missions)
    run.look()
    started = run.status["nextMission"]
    assert (run.phase, list(run.cluster.missions(REF))) == ("Waiting", [1])
    run.cluster.clock.sleep(600.0)
    run.restart()
    run.look()
    assert (run.phase, run.status["nextMission"]) == ("Waiting", started)
    run.cluster.clock.sleep(run.later or 0.0)
    assert run.settle() == [*A_MISSION, "Done"]


@pytest.mark.parametrize("changes", [{}, {"suspend": True}])
def test_a_mission_that_is_made_again_is_of_what_was_flown(run: Reconciled, changes: dict[str, Any]) -> None:
    run.ask(missions={"count": 1})
    run.settle()
    flown = run.cluster.missions(REF)[1]["spec"]
    run.cluster.remove(MISSION, ObjectRef("default", "plots-m0001"))
    run.ask(missions={"count": 1, "seed": 7}, **changes)
    assert run.settle() == ["Done"]
    assert run.cluster.missions(REF)[1]["spec"] == flown
    assert run.cluster.missions(REF)[1]["status"]["phase"] == "Succeeded"


def test_useless_models_are_suspended_and_not_waited_for(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Flying")
    useful: dict[str, float | None] = {"initial": 0.0, "1": 0.75, "2": 0.25, "1-2": 0.0}
    weights = WeightsDocument(number=1, weights=order_of(run, 1).weights, usefulness=useful)
    run.storage.write(PATHS.weights(1), weights.model_dump_json(by_alias=True).encode())
    run.restart()
    run.settle(until="Weighing")
    suspended = {name: run.cluster.job(name)["spec"]["suspend"] for name in run.names("Job") if "aggregator" in name}
    assert suspended == {
        "plots-m0001-aggregator-1": False,
        "plots-m0001-aggregator-1-2": True,
        "plots-m0001-aggregator-2": False,
    }
    levels = {name: run.cluster.job(name)["metadata"]["labels"]["fleetcomputer.io/level"] for name in suspended}
    assert list(levels.values()) == ["8", "0", "3"]


def test_a_job_that_somebody_deletes_is_made_again(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Flying")
    before = run.names("Job")
    run.cluster.remove(JOB, ObjectRef("default", "plots-m0001-workflow-agent-2"))
    run.look()
    assert run.names("Job") == before


def test_the_fleetspec_in_storage_is_the_one_that_is_flown(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Training")
    stored = read_spec(run.storage, PATHS)
    assert stored is not None
    assert stored.metadata.uid == run.body["metadata"]["uid"]
    assert set(json.loads(run.storage.read(PATHS.functions))["files"]) == {"own.py"}
    assert run.status["storageUri"] == f"{run.storage.uri}/{PATHS.root}"


def test_the_users_own_aggregation_is_asked_by_the_trainer_and_never_by_the_operator(run: Reconciled) -> None:
    own: dict[str, Any] = {"kind": "Custom", "function": "own:pairs"}
    run.ask()
    (run.folder / "library" / "plots" / "own.py").write_text(
        FUNCTIONS + "\n\ndef pairs(agents):\n    raise SystemExit\n"
    )
    run.ask(aggregation=own)
    run.settle(until="Training")
    answer = {"function": "own:pairs", "subsets": {"1-2": ["agent-1", "agent-2"]}}
    run.storage.write(PATHS.subsets, json.dumps(answer).encode())
    run.settle()
    assert [name for name in jobs(run) if "aggregator" in name] == ["m0001-aggregator-1-2", "m0002-aggregator-1-2"]


def test_a_pass_in_flight_looks_where_something_may_come_and_nowhere_else(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Flying")
    run.storage.append(PATHS.log(1, "agent-1"), b"{}\n")
    calls, stored = len(run.cluster.calls), len(run.storage_calls)
    run.look()
    log = PATHS.log(1, "agent-1")
    assert run.storage_calls[stored:] == [f"list {PATHS.mission(2)}", f"list {PATHS.mission(1)}", f"read {log}"]
    run.look()
    assert run.storage_calls[stored + 3 :] == [f"list {PATHS.mission(2)}", f"list {PATHS.mission(1)}"]
    assert run.cluster.calls[calls:] == []


def test_a_trainer_that_has_not_started_takes_what_is_asked_for_now(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Training")
    uid = run.cluster.job("plots-train")["metadata"]["uid"]
    run.ask(training={"epochs": 2})
    run.look()
    run.look()
    stored = read_spec(run.storage, PATHS)
    assert stored is not None
    assert stored.spec.training.epochs == 2
    assert run.cluster.job("plots-train")["metadata"]["uid"] != uid


def test_a_trainer_at_work_is_not_disturbed(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Training")
    uid = run.cluster.job("plots-train")["metadata"]["uid"]
    run.cluster.start_job("plots-train")
    run.ask(training={"epochs": 2})
    run.look()
    stored = read_spec(run.storage, PATHS)
    assert stored is not None
    assert stored.spec.training.epochs != 2
    assert run.cluster.job("plots-train")["metadata"]["uid"] == uid
    assert run.settle()[-1] == "Done"

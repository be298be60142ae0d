"""`fleet run` from start to end with stand-ins for the platform's programs: faults, resuming, refusals."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fleet.energy.accounting import FlightCounts
from fleet.energy.model import energy_model
from fleet.errors import ContextError, FleetError, FunctionError, MissionError
from fleet.missions.accounting import agent_metrics
from fleet.missions.documents import Landing, MissionOrder
from fleet_operator.local.application import Application
from fleet_operator.local.events import ContainerDied, JobFailed
from fleet_operator.local.ledger import OtherRun, RunState, only_run, read_document
from fleet_operator.local.outcome import to_json
from fleet_operator.local.service import Summary
from tests.fleet_runs import Recorder, application, fly, set_faults


def run(folder: Path, display: Recorder | None = None, missions: int | None = None, **changes: object) -> Summary:
    return fly(application(folder, missions=missions, **changes), display)


PHASES = [
    "copying contexts",
    "shaping the reward and training",
    "mission 1: flying with 2 agents",
    "mission 1: 3 aggregators retrain",
    "mission 1: weighing the models",
    "mission 2: flying with 2 agents",
    "mission 2: 3 aggregators retrain",
    "mission 2: weighing the models",
    "writing the report",
]


def test_a_fleet_flies_all_its_missions_and_says_what_came_of_them(tmp_path: Path) -> None:
    display = Recorder()
    summary = run(tmp_path, display)
    assert display.phases == PHASES
    assert display.notes == [
        "  plot: pictures are drawn from measured features, they show excess green",
        "  mission 1: accuracy 0.8 (met)",
        "  mission 2: accuracy 0.8 (met)",
    ]
    assert [(mission.number, mission.goals_met) for mission in summary.missions] == [(1, True), (2, True)]
    assert [(model.key, model.usefulness, model.level) for model in summary.models] == [
        ("initial", 0.25, None), ("1", 0.25, 3), ("2", 0.25, 3), ("1-2", 0.25, 3),
    ]  # fmt: skip
    assert summary.missed == ()
    assert summary.report == tmp_path / "out" / "report.html"
    document = read_document(tmp_path / "out")
    assert document is not None
    assert (document.state, document.starts, document.missions) == (RunState.FINISHED, 1, 2)
    assert [phase.name for phase in document.phases] == [
        "preparing", "training", "mission 1", "retraining 1", "weighing 1", "mission 2", "retraining 2", "weighing 2",
    ]  # fmt: skip
    assert document.peak_memory_bytes > 2**20
    assert json.loads(json.dumps(to_json(summary)))["goalsMet"] is True
    assert_mission_2_flew_with_the_models_of_mission_1(application(tmp_path))


def assert_mission_2_flew_with_the_models_of_mission_1(fleet: Application) -> None:
    order = MissionOrder.model_validate_json(fleet.storage.read(fleet.paths.plan(2)))
    assert {model.key: model.path for model in order.models} == {
        "initial": fleet.paths.initial_model,
        **{key: fleet.paths.model(1, key) for key in ("1", "2", "1-2")},
    }
    assert order.weights == {agent: {"initial": 1.0} for agent in ("agent-1", "agent-2")}


def test_an_aggregation_of_the_users_own_that_fails_is_told_before_training(tmp_path: Path) -> None:
    own = {"kind": "Custom", "function": "own:map_observation"}
    display = Recorder()
    with pytest.raises(FunctionError, match="own:map_observation: answered"):
        run(tmp_path, display, aggregation=own)
    assert display.phases == ["copying contexts", "writing the report"]


def test_the_same_command_adds_missions_to_a_finished_run(tmp_path: Path) -> None:
    run(tmp_path, missions=1)
    display = Recorder()
    assert len(run(tmp_path, display, missions=2).missions) == 2
    assert display.phases == ["copying contexts", *PHASES[5:]]


def test_an_agent_whose_workflow_fails_for_good_does_not_keep_the_mission_from_its_end(tmp_path: Path) -> None:
    fleet, display = application(tmp_path, missions=1), Recorder()
    set_faults(fleet, {"workflow agent-2": {"code": 65}})
    summary = fly(fleet, display)
    landing = Landing.model_validate_json(fleet.storage.read(fleet.paths.landing(1, "agent-2")))
    assert landing.failed
    assert landing.message.startswith("workflow of agent-2 failed: workflow ended with exit code 65; the end of")
    assert landing.message.endswith("workflow agent-2 was told to fail")
    counts = FlightCounts((0,) * 8, captures=1, decisions=0, steps=1)
    assert landing.metrics == agent_metrics("agent-2", counts, energy_model(fleet.fleet), groups=0, explored=0)
    assert landing.metrics.edge_energy_j > 0
    assert list(summary.missions[0].failures) == ["agent-2"]
    assert [type(event) for event in display.events if isinstance(event, JobFailed)] == [JobFailed]


def test_an_agent_whose_sensor_fails_for_good_lands_as_failed(tmp_path: Path) -> None:
    fleet = application(tmp_path, missions=1)
    set_faults(fleet, {"sensor agent-1": {"code": 65}})
    summary = fly(fleet)
    assert list(summary.missions[0].failures) == ["agent-1"]
    assert summary.missions[0].failures["agent-1"].startswith("sensor of agent-1 failed: ")


def test_a_workflow_that_fails_now_and_then_is_started_again(tmp_path: Path) -> None:
    fleet, display = application(tmp_path, missions=1), Recorder()
    set_faults(fleet, {"workflow agent-1": {"code": 75, "times": 2}, "aggregator 1-2": {"code": 75}})
    summary = fly(fleet, display)
    assert summary.missions[0].failures == {}
    died = [str(event.subject) for event in display.events if isinstance(event, ContainerDied)]
    assert died == ["workflow of agent-1", "workflow of agent-1", "aggregator of 1-2"]


def test_an_aggregator_that_fails_for_good_is_given_up_and_the_fleet_flies_on(tmp_path: Path) -> None:
    fleet = application(tmp_path)
    set_faults(fleet, {"aggregator 2": {"code": 65, "times": 1}})
    assert len(fly(fleet).missions) == 2
    order = MissionOrder.model_validate_json(fleet.storage.read(fleet.paths.plan(2)))
    assert [model.key for model in order.models] == ["initial", "1", "1-2"]


def test_a_mission_that_nobody_can_evaluate_ends_the_run_with_the_reason(tmp_path: Path) -> None:
    fleet = application(tmp_path, missions=1)
    set_faults(fleet, {"eval": {"code": 65, "times": 100}})
    with pytest.raises(MissionError, match="mission 1 cannot be evaluated: workflow of agent-2 failed") as caught:
        fly(fleet)
    assert "eval was told to fail" in str(caught.value)
    document = read_document(fleet.out)
    assert document is not None
    assert (document.state, document.message) == (RunState.FAILED, str(caught.value))
    set_faults(fleet, {})
    assert len(run(tmp_path, missions=1).missions) == 1


def test_a_trainer_that_fails_ends_the_run_with_the_end_of_its_log(tmp_path: Path) -> None:
    fleet = application(tmp_path)
    set_faults(fleet, {"trainer Train": {"code": 65}})
    with pytest.raises(FleetError) as caught:
        fly(fleet)
    assert str(caught.value).startswith("trainer failed: trainer ended with exit code 65")
    assert str(caught.value).endswith("trainer Train was told to fail")


def test_a_trainer_that_leaves_nothing_ends_the_run(tmp_path: Path) -> None:
    fleet = application(tmp_path)
    set_faults(fleet, {"trainer Train": {"code": 0}})
    with pytest.raises(MissionError, match="the trainer ended without a result; its log is"):
        fly(fleet)


def test_a_missed_goal_is_in_the_summary(tmp_path: Path) -> None:
    summary = run(tmp_path, missions=1, goals=[{"metric": "accuracy", "atLeast": 0.9}])
    assert [result.goal.at_least for result in summary.missed] == [0.9]
    assert to_json(summary)["goalsMet"] is False


def test_a_suspended_fleet_flies_nothing_more(tmp_path: Path) -> None:
    display = Recorder()
    assert run(tmp_path, display, suspend=True).missions == ()
    assert display.phases == [*PHASES[:2], PHASES[-1]]


@pytest.mark.parametrize(
    ("seed", "changes", "different"),
    [
        (7, {}, "the seed"),
        (None, {"agents": {"count": 3}}, "the FleetSpec"),
    ],
)
def test_the_run_of_something_else_is_refused_with_what_differs(
    tmp_path: Path, seed: int | None, changes: dict[str, object], different: str
) -> None:
    run(tmp_path, missions=1)
    other = application(tmp_path, missions=1, seed=seed, **changes)
    with pytest.raises(OtherRun) as caught:
        fly(other)
    assert str(caught.value) == (
        f"{other.out} has a run that differs in {different}; "
        "choose another folder with --out, or remove that run with --fresh"
    )
    assert len(fly(other, fresh=True).missions) == 1


def test_other_functions_and_contexts_are_other_runs_but_more_memory_is_not(tmp_path: Path) -> None:
    run(tmp_path, missions=1)
    run(tmp_path, missions=1, workflow={"resources": {"limits": {"memory": "1Gi"}}})
    fleet = application(tmp_path, missions=1)
    (fleet.file.parent / "own.py").write_text("def map_observation(observation):\n    return {}\n")
    manifest = fleet.file.parent / "field" / "context.yaml"
    manifest.write_text(f"{manifest.read_text()}# changed\n")
    changed = fleet.__class__(fleet.spec, fleet.file, fleet.out, fleet.storage, type(fleet.bundle)({"own.py": b""}))
    with pytest.raises(OtherRun, match="differs in the functions, context field;"):
        fly(changed)


def test_what_was_trained_alone_is_gone_over_again_and_flown(tmp_path: Path) -> None:
    fleet, display = application(tmp_path, missions=1), Recorder()
    fleet.storage.write(fleet.paths.fleet_spec, fleet.spec.model_dump_json(by_alias=True).encode())
    for path in (fleet.paths.reward, fleet.paths.initial_model):
        fleet.storage.write(path, b"of functions that may have changed since")
    assert len(fly(fleet, display).missions) == 1
    assert display.phases[:3] == PHASES[:3]
    assert fleet.storage.read(fleet.paths.initial_model) == b"model"


def test_missions_without_their_ledger_are_not_gone_on_with(tmp_path: Path) -> None:
    run(tmp_path, missions=1)
    (tmp_path / "out" / "run.json").unlink()
    with pytest.raises(OtherRun, match="differs in the functions, context field"):
        run(tmp_path, missions=2)


def test_a_context_that_is_not_there_or_not_good_is_told_before_anything_runs(tmp_path: Path) -> None:
    fleet = application(tmp_path)
    (fleet.file.parent / "field" / "features.parquet").write_bytes(b"not parquet")
    display = Recorder()
    with pytest.raises(ContextError):
        fly(fleet, display)
    assert display.events == []
    assert not (fleet.out / "logs").exists()


def test_two_runs_in_one_folder_are_refused(tmp_path: Path) -> None:
    fleet = application(tmp_path)
    with only_run(fleet.out), pytest.raises(OtherRun, match="another `fleet run` works in"):
        fly(fleet)

"""What goes wrong with a fleet in a cluster: what is said of it, what goes on without it, and how it heals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from fleet.contexts.files import write_cube
from fleet.errors import StorageError, StorageFull, StorageUnavailable
from fleet.missions.documents import Landing, MissionEvaluation
from fleet.storage.local import LocalStorage
from fleet_operator.cluster.errors import ClusterError, Forbidden, Invalid
from fleet_operator.resources.refs import ObjectRef
from fleet_operator.resources.views import NodeView, PodView
from tests.context_builders import plot
from tests.fleet_runs import FUNCTIONS
from tests.kstatus import kstatus
from tests.reconciled import PATHS, REF, Reconciled

WORKFLOW, SENSOR = "plots-m0001-workflow-agent-2", "plots-m0001-sensor-agent-2"
FELL = "Job has reached the specified backoff limit"


@pytest.fixture
def run(tmp_path: Path, quick_disk: None) -> Reconciled:
    return Reconciled(tmp_path)


def landing(run: Reconciled, agent: str) -> Landing:
    return Landing.model_validate_json(run.storage.read(PATHS.landing(1, agent)))


def evaluation(run: Reconciled) -> MissionEvaluation:
    return MissionEvaluation.model_validate_json(run.storage.read(PATHS.evaluation(1)))


def pod(job: str, **changes: Any) -> PodView:
    given: dict[str, Any] = {
        "phase": "Pending", "node": "hub", "waiting": "", "message": "", "restarts": 0, "containers": {}, **changes
    }  # fmt: skip
    return PodView(ref=ObjectRef("default", f"{job}-abcde"), job=job, **given)


def test_an_agent_whose_workflow_fails_lands_as_failed_and_the_mission_goes_on(run: Reconciled) -> None:
    run.ask(missions={"count": 1})
    run.settle(until="Flying")
    run.cluster.start_job(SENSOR)
    run.cluster.end_job(WORKFLOW, FELL)
    run.look()
    assert landing(run, "agent-2").message == f"the workflow of agent-2 failed: {FELL}"
    assert run.conditions()["Degraded"] == ("True", "AgentFailed")
    assert SENSOR not in run.names("Job")
    run.settle()
    assert run.phase == "Done"
    assert list(evaluation(run).failures) == ["agent-2"]
    agents = run.cluster.missions(REF)[1]["status"]["agents"]
    assert [(agent["name"], agent["phase"]) for agent in agents] == [("agent-1", "Landed"), ("agent-2", "Failed")]


def test_an_agent_without_a_sensor_is_stopped_and_lands_when_its_pods_are_gone(run: Reconciled) -> None:
    run.ask(missions={"count": 1})
    run.settle(until="Flying")
    run.cluster.start_job(WORKFLOW)
    run.cluster.end_job(SENSOR, FELL)
    run.cluster.pod_views = {WORKFLOW: (pod(WORKFLOW, phase="Running"),)}
    run.look()
    assert WORKFLOW not in run.names("Job")
    run.look()
    assert not run.storage.exists(PATHS.landing(1, "agent-2"))
    run.cluster.pod_views = {}
    run.look()
    assert landing(run, "agent-2").message == f"the sensor of agent-2 failed: {FELL}"
    assert run.settle()[-1] == "Done"


def test_a_workflow_that_ends_without_a_landing_has_failed(run: Reconciled) -> None:
    run.ask(missions={"count": 1})
    run.settle(faults={WORKFLOW: ""})
    assert landing(run, "agent-2").message == "the workflow of agent-2 ended without a landing"
    assert run.phase == "Done"


def test_an_aggregator_that_fails_is_given_up(run: Reconciled) -> None:
    run.ask(missions={"count": 1})
    run.settle(faults={"plots-m0001-aggregator-1": FELL, "plots-m0001-aggregator-2": ""}, until="Weighing")
    assert run.conditions()["Degraded"] == ("True", "AggregatorFailed")
    assert run.message("Degraded") == (
        f"mission 1: the aggregator of 1 failed: {FELL}; "
        "mission 1: the aggregator of 2 failed: it ended without a result"
    )
    assert run.settle()[-1] == "Done"


def test_a_trainer_that_fails_stalls_the_fleet_until_the_user_changes_something(run: Reconciled) -> None:
    run.ask()
    run.settle(faults={"plots-train": FELL})
    assert run.conditions()["Stalled"] == ("True", "Failed")
    assert run.message("Stalled") == f"training failed: {FELL}; see the log of Job plots-train"
    run.restart()
    calls = len(run.cluster.calls)
    run.look()
    assert run.cluster.calls[calls:] == []
    run.ask(training={"epochs": 3})
    assert run.settle()[-1] == "Done"


def test_a_weighing_that_ends_without_weights_stalls_the_fleet(run: Reconciled) -> None:
    run.ask()
    run.settle(faults={"plots-m0001-weigh": ""})
    expected = "weighing mission 1 failed: the trainer ended without a result; see the log of Job plots-m0001-weigh"
    assert run.message("Stalled") == expected
    run.ask(workflow={"trainerResources": {"limits": {"memory": "4Gi"}}})
    assert run.settle()[-1] == "Done"


def test_agents_evaluate_one_after_another_when_nobody_has_and_then_with_what_the_user_mends(run: Reconciled) -> None:
    evaluators = {f"plots-m0001-evaluate-agent-{number}": FELL for number in (1, 2)}
    run.ask(missions={"count": 1})
    run.settle(until="Flying")
    for job in run.names("Job"):
        run.cluster.end_job(job)
    run.storage.delete(PATHS.evaluation(1))
    run.settle(faults=evaluators)
    assert run.message("Stalled") == f"mission 1 cannot be evaluated: {FELL}"
    assert set(evaluators) <= set(run.names("Job"))
    (run.folder / "library" / "plots" / "own.py").write_text(FUNCTIONS + "\nMENDED = True\n")
    run.ask(missions={"count": 1}, eval={"function": "own:evaluate", "timeout": "20s"})
    assert run.settle()[-1] == "Done"
    assert evaluation(run).failures == {}


def test_a_mission_that_every_agent_failed_is_flown_again_when_the_user_changes_something(run: Reconciled) -> None:
    faults = {f"plots-m0001-workflow-agent-{number}": FELL for number in (1, 2)}
    run.ask(missions={"count": 1})
    run.settle(faults=faults)
    assert run.message("Stalled") == "every agent failed in mission 1; see their landing.json"
    run.ask(missions={"count": 2})
    run.look()
    assert run.phase == "Failed"
    run.ask(missions={"count": 1}, map={"function": "own:map_observation", "timeout": "20s"})
    assert run.settle()[-1] == "Done"
    assert evaluation(run).failures == {}
    assert run.conditions()["Degraded"] == ("False", "NoTrouble")


def test_a_fleetspec_that_is_not_valid_is_refused_with_everything_that_is_wrong(run: Reconciled) -> None:
    run.ask(stateSpace={"context": "nowhere"}, sa={"pretrained": "../model.npz"})
    run.look()
    assert (run.later, run.phase) == (None, "Refused")
    assert run.conditions()["Compiled"] == ("False", "Invalid")
    assert (run.conditions()["Stalled"], kstatus(run.body)) == (("True", "Invalid"), "Failed")
    assert 'no context is called "nowhere"' in run.message("Compiled")
    assert run.storage_calls == ["read _claims/default.plots.json"]
    calls = len(run.cluster.calls)
    run.look()
    assert run.cluster.calls[calls:] == []
    run.ask()
    assert run.settle()[-1] == "Done"


def test_names_that_lead_out_of_the_folder_are_refused(run: Reconciled) -> None:
    run.ask(contexts=[{"name": "field", "uri": "../../etc", "use": ["Shaping", "Training", "Mission"]}])
    run.look()
    assert "../../etc is not below the folder of the FleetSpec" in run.message("Compiled")


def test_a_broken_context_is_told_and_looked_at_again(run: Reconciled) -> None:
    run.ask()
    table = run.folder / "library" / "plots" / "field" / "features.parquet"
    whole = table.read_bytes()
    table.write_bytes(b"no table")
    run.look()
    assert (run.later, run.conditions()["Compiled"]) == (60.0, ("False", "ContextBroken"))
    assert "features.parquet" in run.message("Compiled")
    table.write_bytes(whole)
    assert run.settle()[-1] == "Done"


def test_a_context_at_an_address_is_copied_and_another_one_replaces_it(run: Reconciled) -> None:
    other = run.folder / "storage" / "elsewhere"
    write_cube(plot(), LocalStorage(other))
    context = {"name": "field", "uri": other.as_uri(), "use": ["Shaping", "Training", "Mission"]}
    run.ask(contexts=[context])
    run.settle(until="Training")
    assert run.storage.read(f"{PATHS.context('field')}/features.parquet") == (other / "features.parquet").read_bytes()
    assert other.as_uri().encode() in run.storage.read(PATHS.origin("field"))


@pytest.mark.parametrize(
    ("error", "reason"), [(StorageUnavailable, "StorageUnavailable"), (StorageFull, "StorageFull")]
)
def test_a_storage_in_trouble_degrades_the_fleet_and_leaves_the_rest_of_its_status(
    run: Reconciled, error: type[StorageError], reason: str
) -> None:
    run.ask()
    run.settle(until="Flying")
    before = run.conditions()

    def refuse(name: str) -> None:
        raise error("the NameNode does not answer")

    run.before_storage = refuse
    run.restart()
    run.look()
    assert (run.later, run.phase) == (10.0, "Flying")
    assert run.conditions() == before | {"Degraded": ("True", reason)}
    run.before_storage = lambda name: None
    run.look()
    assert run.conditions() == before
    assert run.settle()[-1] == "Done"


def test_a_damaged_document_is_said_by_its_name(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Weighing")
    run.storage.write(PATHS.evaluation(1), b"{")
    run.restart()
    run.look()
    assert "default/plots/missions/0001/evaluation.json" in run.message("Degraded")


def test_what_the_api_server_refuses_is_told_and_tried_again(run: Reconciled) -> None:
    run.ask()

    def refuse(name: str) -> None:
        if name == "apply Job plots-train":
            raise Forbidden('jobs.batch "plots-train" is forbidden: exceeded quota: small')

    run.cluster.before_call = refuse
    with pytest.raises(Forbidden):
        run.look()
    assert run.conditions()["Degraded"] == ("True", "QuotaExceeded")
    run.cluster.before_call = lambda name: None
    assert run.settle()[-1] == "Done"


IMAGE = {"waiting": "ImagePullBackOff", "message": "no such image"}
TROUBLES: list[tuple[dict[str, Any], str]] = [
    (IMAGE, "ImageMissing"),
    ({"waiting": "Unschedulable", "message": "0/2 nodes", "node": ""}, "Unschedulable"),
    ({"waiting": "CreateContainerConfigError"}, "ConfigMissing"),
    ({"waiting": "CrashLoopBackOff", "restarts": 3}, "PodFailing"),
    ({"phase": "Failed", "message": "exit code 75"}, "PodFailing"),
]


@pytest.mark.parametrize(("changes", "reason"), TROUBLES)
def test_pods_that_do_not_start_are_told_after_a_while_and_no_longer_when_they_do(
    run: Reconciled, changes: dict[str, Any], reason: str
) -> None:
    run.ask()
    run.settle(until="Training")
    run.cluster.pod_views = {"plots-train": (pod("plots-train", **changes),)}
    run.look()
    assert run.conditions()["Degraded"] == ("False", "NoTrouble")
    run.cluster.clock.sleep(11.0)
    run.look()
    assert run.conditions()["Degraded"] == ("True", reason)
    run.cluster.start_job("plots-train")
    run.look()
    assert run.conditions()["Degraded"] == ("False", "NoTrouble")


def test_an_image_that_cannot_be_got_for_minutes_stalls_the_fleet_until_it_is_there(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Training")
    trainer = pod("plots-train", **IMAGE, started_s=run.cluster.clock.now())
    run.cluster.pod_views = {"plots-train": (trainer,)}
    run.cluster.clock.sleep(200.0)
    run.look()
    assert (run.later, run.conditions()["Stalled"]) == (15.0, ("False", "GoesOn"))
    run.cluster.clock.sleep(101.0)
    run.look()
    assert (run.later, run.conditions()["Stalled"]) == (15.0, ("True", "ImageMissing"))
    assert kstatus(run.body) == "Failed"
    run.cluster.start_job("plots-train")
    run.look()
    assert run.conditions()["Stalled"] == ("False", "GoesOn")
    assert run.settle()[-1] == "Done"


def test_a_fleet_of_which_a_part_is_at_work_is_not_stalled(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Flying")
    run.cluster.pod_views = {WORKFLOW: (pod(WORKFLOW, **IMAGE, started_s=run.cluster.clock.now()),)}
    for agent in (1, 2):
        run.cluster.start_job(f"plots-m0001-sensor-agent-{agent}")
    run.cluster.start_job("plots-m0001-workflow-agent-1")
    run.cluster.clock.sleep(301.0)
    run.look()
    assert (run.conditions()["Degraded"], run.conditions()["Stalled"][0]) == (("True", "ImageMissing"), "False")
    run.cluster.end_job("plots-m0001-workflow-agent-1")
    run.look()
    assert run.conditions()["Stalled"] == ("True", "ImageMissing")


def test_a_job_without_pods_says_why_kubernetes_makes_none(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Training")
    run.cluster.warnings = {"plots-train": (("FailedCreate", 'pods "x" is forbidden: exceeded quota: small'),)}
    run.cluster.clock.sleep(11.0)
    run.look()
    assert run.conditions()["Degraded"] == ("True", "QuotaExceeded")


def test_a_trouble_that_stays_is_looked_at_ever_more_rarely_and_told_all_the_time(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Training")
    run.cluster.warnings = {"plots-train": (("FailedCreate", 'pods "x" is forbidden: exceeded quota: small'),)}
    run.cluster.clock.sleep(11.0)
    began = len(run.cluster.calls)
    for _ in range(60):
        run.look()
        assert run.conditions()["Degraded"] == ("True", "QuotaExceeded")
        run.cluster.clock.sleep(5.0)
    looks = [call for call in run.cluster.calls[began:] if call.startswith("complaints")]
    assert len(looks) == 11  # after 0, 10 and 30 seconds, then every 30


def test_aggregators_that_wait_for_each_other_are_no_trouble(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Retraining")
    waiting = "plots-m0001-aggregator-1"
    run.cluster.pod_views = {waiting: (pod(waiting, waiting="Unschedulable", node=""),)}
    run.cluster.clock.sleep(11.0)
    run.cluster.start_job("plots-m0001-aggregator-2")
    run.look()
    assert run.conditions()["Degraded"] == ("False", "NoTrouble")


def test_a_job_whose_machine_is_gone_is_made_anew_on_another(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Flying")
    uid = run.cluster.job(WORKFLOW)["metadata"]["uid"]
    hub, edge = run.cluster.machines
    run.cluster.machines = (hub, NodeView(edge.name, edge.role, edge.addresses, False, True, 2.0, 4e9))
    run.cluster.pod_views = {WORKFLOW: (pod(WORKFLOW, phase="Running", node="edge1", deleting=True),)}
    run.cluster.clock.sleep(11.0)
    run.look()
    assert run.conditions()["Degraded"] == ("True", "NodeLost")
    run.cluster.pod_views = {}
    run.look()
    assert run.cluster.job(WORKFLOW)["metadata"]["uid"] != uid
    assert run.settle()[-1] == "Done"


def test_aggregators_that_run_on_get_what_the_others_had(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Retraining")
    running, ended = "plots-m0001-aggregator-1", ("plots-m0001-aggregator-2", "plots-m0001-aggregator-1-2")
    main = run.cluster.job(running)["spec"]["template"]["spec"]["containers"][0]
    run.cluster.start_job(running)
    for job in ended:
        run.cluster.end_job(job)
    has = {"aggregator": main["resources"]}
    run.cluster.pod_views = {running: (pod(running, phase="Running", node="hub", containers=has),)}
    for _ in range(2):
        run.look()
    ((name, resources),) = run.cluster.resized
    assert name == f"{running}-abcde"
    assert resources == {"requests": main["resources"]["requests"], "limits": {"cpu": "4", "memory": "8192Mi"}}


def test_aggregators_that_run_divide_what_those_that_find_no_node_do_not_use_yet(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Retraining")
    running, queueing = "plots-m0001-aggregator-1", ("plots-m0001-aggregator-2", "plots-m0001-aggregator-1-2")
    main = run.cluster.job(running)["spec"]["template"]["spec"]["containers"][0]
    run.cluster.start_job(running)
    run.cluster.pod_views = {job: (pod(job, node="", waiting="Unschedulable"),) for job in queueing}
    run.cluster.pod_views[running] = (
        pod(running, phase="Running", node="hub", containers={"aggregator": main["resources"]}),
    )
    for _ in range(2):
        run.look()
    ((name, resources),) = run.cluster.resized
    assert name == f"{running}-abcde"
    assert resources == {"requests": main["resources"]["requests"], "limits": {"cpu": "4", "memory": "8192Mi"}}


@pytest.mark.parametrize("error", [Forbidden("exceeded quota: small"), Invalid("cpu: must be less than 2")])
def test_an_aggregator_that_may_not_be_resized_works_on_with_what_it_has(
    run: Reconciled, error: ClusterError, caplog: pytest.LogCaptureFixture
) -> None:
    run.ask()
    run.settle(until="Retraining")
    running, ended = ("plots-m0001-aggregator-1", "plots-m0001-aggregator-1-2"), "plots-m0001-aggregator-2"
    run.cluster.end_job(ended)
    for job in running:
        run.cluster.start_job(job)
        main = run.cluster.job(job)["spec"]["template"]["spec"]["containers"][0]
        has = {"aggregator": main["resources"]}
        run.cluster.pod_views[job] = (pod(job, phase="Running", node="hub", containers=has),)
    asked = []

    def refuse(name: str) -> None:
        if name.startswith("resize"):
            asked.append(name)
            raise error

    run.cluster.before_call = refuse
    for _ in range(2):
        run.look()
    assert set(asked) == {f"resize {job}-abcde" for job in running}
    assert len(asked) == len(running)
    assert [record.getMessage() for record in caplog.records] == [
        f"default/plots: some aggregators of mission 1 keep what they have: {error}"
    ]
    assert run.conditions()["Reconciling"] == ("False", "Retraining")
    assert run.settle()[-1] == "Done"


def test_aggregators_go_to_the_machines_that_hold_their_data(run: Reconciled) -> None:
    run.held[PATHS.log(1, "agent-1")] = {"10.0.0.2": 70}
    run.held[PATHS.log(1, "agent-2")] = {"edge1": 30, "10.0.0.1": 100, "elsewhere": 5}
    run.ask()
    run.settle(until="Retraining")
    job = run.cluster.job("plots-m0001-aggregator-1-2")["spec"]["template"]["spec"]
    affinity = job["affinity"]["nodeAffinity"]["preferredDuringSchedulingIgnoredDuringExecution"]
    assert [(term["weight"], term["preference"]["matchExpressions"][0]["values"]) for term in affinity] == [
        (100, ["edge1"]),
        (100, ["hub"]),
    ]


@pytest.mark.parametrize(
    ("message", "told"),
    [
        ('MountVolume.SetUp failed for volume "functions" : configmap "plots-functions" not found', "True"),
        ('MountVolume.SetUp failed for volume "functions" : failed to sync configmap cache: timed out', "False"),
    ],
)
def test_a_volume_that_is_not_there_is_told_and_one_that_a_kubelet_has_not_heard_of_yet_is_not(
    run: Reconciled, message: str, told: str
) -> None:
    run.ask()
    run.settle(until="Training")
    trainer = pod("plots-train", phase="Pending", node="edge1")
    run.cluster.pod_views = {"plots-train": (trainer,)}
    run.cluster.warnings = {trainer.ref.name: (("FailedMount", message),)}
    run.cluster.clock.sleep(11.0)
    run.look()
    assert run.conditions()["Degraded"][0] == told

"""Situations of fleets for tests of their status: one for each phase, step and trouble, and random ones.

Steps, troubles and refusals are those that the operator itself makes of what it sees.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from hypothesis import strategies as st

from fleet.errors import FleetError, Problem, SpecError, StorageUnavailable
from fleet.functions.contract import AgentMetrics
from fleet.missions.documents import GoalResult, MissionEvaluation, judge
from fleet.spec.swarm import Goal
from fleet_operator.policy.lifecycle import Course, MissionProgress, Progress, next_step
from fleet_operator.policy.mission_status import MissionSituation
from fleet_operator.policy.status import Situation, Trouble
from fleet_operator.policy.troubles import of_agents, of_pod, of_storage
from fleet_operator.reconcile import asked
from fleet_operator.reconcile.tell import unobserved
from fleet_operator.resources import names
from fleet_operator.resources.refs import ObjectRef
from fleet_operator.resources.views import PodView

AGENTS = ("agent-1", "agent-2")
DUE = frozenset({"1", "2", "1-2"})
GOALS = (Goal(metric="accuracy", at_least=0.7), Goal(metric="time_s", at_most=600, weight=0.5))
NOW = "2026-08-01T06:00:00Z"
EPOCH_S = 1_785_564_000.0
"""`NOW` in seconds."""

ORDERED = MissionProgress(ordered=True)
HALF_LANDED = replace(ORDERED, landed=frozenset({"agent-1"}))
LANDED = replace(ORDERED, landed=frozenset(AGENTS))
EVALUATED = replace(LANDED, evaluated=True, due=DUE)
REPORTED = replace(EVALUATED, retrained=frozenset({"1"}))
OVER = replace(EVALUATED, retrained=DUE, weighed=True, ended_s=EPOCH_S)


def evaluation(number: int, accuracy: float, **failures: str) -> MissionEvaluation:
    """The evaluation of a mission; 0.7 of accuracy is enough."""
    metrics = {"accuracy": accuracy, "coverage": 0.25, "time_s": 500.0}
    results: tuple[GoalResult, ...] = judge(GOALS, metrics)
    agents = tuple(AgentMetrics(agent, steps=10 * number) for agent in AGENTS)
    return MissionEvaluation(
        number=number, context="field", metrics=metrics, goals=results, agents=agents, failures=failures
    )


def trained(*missions: MissionProgress) -> Progress:
    """What a fleet has reached that may fly."""
    return Progress(prepared=True, trained=True, missions=missions, now_s=EPOCH_S)


COURSE = Course(AGENTS, missions=3)
PREPARED = Progress(prepared=True, now_s=EPOCH_S)


def situation(
    progress: Progress,
    last: MissionEvaluation | None = None,
    *troubles: Trouble,
    refusal: Trouble | None = None,
    course: Course = COURSE,
) -> Situation:
    """A situation of a fleet that is to fly three missions, at the step that it takes next."""
    return Situation(
        generation=3,
        step=next_step(course, progress),
        refusal=refusal,
        progress=progress,
        shaped=progress.trained,
        last=last,
        troubles=troubles,
        storage_uri="webhdfs://fleet@namenode:9870/fleet",
        now=NOW,
        missions=course.missions,
    )


def blind(*troubles: Trouble, refusal: Trouble | None = None) -> Situation:
    """A situation in which nothing could be observed, or in which there is nothing."""
    return replace(unobserved(3, refusal, EPOCH_S), troubles=troubles)


def pod_trouble(job: str, waiting: str, message: str, age_s: float) -> Trouble:
    """What is said of a pod that waits."""
    node = "" if waiting == "Unschedulable" else "gateway-1"
    pod = PodView(
        ObjectRef("fields", f"{job}-x"), job, "Pending", node, waiting, message, 0, {}, False, EPOCH_S - age_s
    )
    trouble = of_pod(job, pod, EPOCH_S)
    assert trouble is not None
    return trouble


def refusal(reason: str, error: FleetError, advice: str = "") -> Trouble:
    """What is said of a FleetSpec that is refused."""
    trouble = asked.refused(reason, error, advice).refusal
    assert trouble is not None
    return trouble


TRAINER = names.training_job("crops")
PULLING = pod_trouble(TRAINER, "ErrImagePull", "registry.farm does not answer", 30.0)
IMAGE = pod_trouble(TRAINER, "ImagePullBackOff", "farm/map:2 not found", 400.0)
NO_ROOM = pod_trouble("crops-m0001-workflow-agent-2", "Unschedulable", "0/4 nodes have room", 0.0)
BATTERY = {"agent-1": "its battery is empty"}
AGENT = of_agents(1, BATTERY)
STORAGE = of_storage(StorageUnavailable("namenode:9870 does not answer"))
FILES = refusal(
    asked.FILES_MISSING,
    SpecError([Problem("spec.map.function", "crops.py is nowhere")]),
    "apply the files beside it: fleet files fleetspec.yaml | kubectl apply -f -",
)
INVALID = refusal(asked.INVALID, SpecError([Problem("spec.missions.schedule", "is not a schedule")]))
TAKEN = refusal(asked.STORAGE_TAKEN, FleetError("fields/crops has the data of a fleet with other agents"))
BROKEN = f"training failed: BackoffLimitExceeded; see the log of Job {TRAINER}"

SITUATIONS: dict[str, Situation] = {
    "nothing was observed yet": blind(),
    "the storage does not answer at first": blind(STORAGE),
    "files are missing": blind(refusal=FILES),
    "the FleetSpec is invalid": blind(refusal=INVALID),
    "the storage is another's": blind(refusal=TAKEN),
    "files are missing in flight": situation(trained(OVER, ORDERED), evaluation(1, 0.8), refusal=FILES),
    "the FleetSpec is invalid in flight": situation(trained(OVER, ORDERED), evaluation(1, 0.8), refusal=INVALID),
    "preparing": situation(Progress(now_s=EPOCH_S)),
    "shaping": situation(PREPARED),
    "training": replace(situation(PREPARED), shaped=True),
    "the image of the trainer is pulled again": situation(PREPARED, None, PULLING),
    "the image of the trainer is missing": situation(PREPARED, None, IMAGE),
    "the trainer is broken": situation(replace(PREPARED, broken=BROKEN)),
    "ordering the first mission": situation(trained()),
    "flying": situation(trained(ORDERED)),
    "flying, one has landed": situation(trained(HALF_LANDED)),
    "flying, one has failed": situation(trained(HALF_LANDED), None, AGENT),
    "flying, no machine has room": situation(trained(ORDERED), None, NO_ROOM, STORAGE),
    "all have landed": situation(trained(LANDED)),
    "retraining": situation(trained(REPORTED), evaluation(1, 0.8)),
    "retraining after a missed goal": situation(trained(REPORTED), evaluation(1, 0.6, **BATTERY), AGENT),
    "weighing": situation(trained(replace(EVALUATED, retrained=DUE)), evaluation(1, 0.8)),
    "waiting": situation(trained(OVER), evaluation(1, 0.8), course=replace(COURSE, interval_s=60.0)),
    "weighing is broken, and what is to help lacks files": situation(
        replace(
            trained(EVALUATED), broken="weighing mission 1 failed: out of memory; see the log of Job crops-m0001-weigh"
        ),
        evaluation(1, 0.8),
        refusal=FILES,
    ),
    "suspended before the first mission": situation(trained(), course=replace(COURSE, suspended=True)),
    "suspended": situation(trained(OVER), evaluation(1, 0.8), course=replace(COURSE, suspended=True)),
    "flying the second mission": situation(trained(OVER, ORDERED), evaluation(1, 0.8)),
    "every agent failed": situation(
        trained(replace(EVALUATED, failed=frozenset(AGENTS))),
        evaluation(1, 0.0, **dict.fromkeys(AGENTS, "its battery is empty")),
    ),
    "done": situation(trained(OVER, OVER, OVER), evaluation(3, 0.9)),
    "done, goals missed": situation(trained(OVER, OVER, OVER), evaluation(3, 0.5)),
}
"""One for each phase, step and kind of trouble."""

_words = st.sampled_from(["ImageMissing", "ErrImagePull", "Quota exceeded", "2many", "", "Unschedulable"])
troubles = st.builds(Trouble, _words, st.text(max_size=30) | st.just("x" * 1100), st.booleans())


@st.composite
def situations(draw: st.DrawFn) -> Situation:
    """Any situation above with another generation, time, troubles and refusal."""
    base = SITUATIONS[draw(st.sampled_from(sorted(SITUATIONS)))]
    return replace(
        base,
        generation=draw(st.integers(1, 3)),
        now=draw(st.sampled_from([NOW, "2026-08-01T06:00:01Z", "2027-01-01T00:00:00Z"])),
        troubles=tuple(draw(st.lists(troubles, max_size=5))),
        refusal=draw(st.just(base.refusal) | st.none() | troubles),
    )


def mission(progress: MissionProgress, **given: Any) -> MissionSituation:
    """A situation of a mission."""
    return MissionSituation(
        AGENTS, progress, "webhdfs://fleet@namenode:9870/fleet/default/crops/missions/0001", NOW, **given
    )


MISSIONS: dict[str, MissionSituation] = {
    "ordered": mission(ORDERED),
    "flying": mission(ORDERED, running=frozenset(AGENTS), steps={"agent-1": 4}),
    "flying, one has landed": mission(HALF_LANDED, running=frozenset({"agent-2"})),
    "flying, one has failed": mission(
        replace(HALF_LANDED, failed=frozenset({"agent-1"})), running=frozenset({"agent-2"})
    ),
    "all have landed": mission(LANDED),
    "cannot be evaluated": mission(LANDED, broken="mission 1 cannot be evaluated: Eval() raised KeyError"),
    "retraining": mission(REPORTED, evaluation=evaluation(1, 0.8)),
    "over": mission(OVER, evaluation=evaluation(1, 0.8)),
    "over, one has failed, a goal is missed": mission(
        OVER, evaluation=evaluation(1, 0.6, **{"agent-1": "its battery is empty"})
    ),
    "every agent failed": mission(
        EVALUATED, evaluation=evaluation(1, 0.0, **dict.fromkeys(AGENTS, "its battery is empty"))
    ),
}
"""One for each phase of a mission."""

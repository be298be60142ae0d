"""Situations of fleets for tests of their status: one for each phase, step and trouble, and random ones."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from hypothesis import strategies as st

from fleet.functions.contract import AgentMetrics
from fleet.missions.documents import GoalResult, MissionEvaluation, judge
from fleet.spec.swarm import Goal
from fleet_operator.policy.lifecycle import (
    Done,
    Failed,
    Fly,
    MissionProgress,
    Order,
    Prepare,
    Progress,
    Retrain,
    Step,
    Suspended,
    Train,
    Wait,
    Weigh,
)
from fleet_operator.policy.mission_status import MissionSituation
from fleet_operator.policy.status import Situation, Trouble

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


def situation(
    step: Step | None,
    progress: Progress | None = None,
    last: MissionEvaluation | None = None,
    *troubles: Trouble,
    refusal: Trouble | None = None,
) -> Situation:
    """A situation of a fleet that is to fly three missions."""
    reached = progress or Progress()
    return Situation(
        generation=3,
        step=step,
        refusal=refusal,
        progress=reached,
        shaped=reached.trained,
        last=last,
        troubles=troubles,
        storage_uri="webhdfs://fleet@namenode:9870/fleet",
        now=NOW,
        missions=3,
    )


IMAGE = Trouble("ImageMissing", "the image farm/map:2 of map cannot be pulled", lasting=True)
AGENT = Trouble("AgentFailed", "agent-1 failed: its battery is empty")
STORAGE = Trouble("StorageUnavailable", "namenode:9870 does not answer")
FILES = Trouble("FilesMissing", "crops.py is nowhere; run `fleet files fleetspec.yaml | kubectl apply -f -`")
INVALID = Trouble("SpecInvalid", "spec.missions.schedule: is not a schedule", lasting=True)

SITUATIONS: dict[str, Situation] = {
    "nothing was observed yet": situation(None),
    "the storage does not answer at first": situation(None, None, None, STORAGE),
    "files are missing": situation(None, refusal=FILES),
    "the FleetSpec is invalid": situation(None, refusal=INVALID),
    "files are missing after a mission": situation(Order(2), trained(OVER), evaluation(1, 0.8), refusal=FILES),
    "preparing": situation(Prepare()),
    "shaping": situation(Train(), Progress(prepared=True)),
    "training": replace(situation(Train(), Progress(prepared=True)), shaped=True),
    "the image of the trainer is missing": situation(Train(), Progress(prepared=True), None, IMAGE),
    "the trainer is broken": situation(Failed("the trainer failed: no context"), Progress(prepared=True)),
    "ordering the first mission": situation(Order(1), trained()),
    "flying": situation(Fly(1, AGENTS), trained(ORDERED)),
    "flying, one has landed": situation(Fly(1, ("agent-2",)), trained(HALF_LANDED)),
    "flying, one has failed": situation(Fly(1, ("agent-2",)), trained(HALF_LANDED), None, AGENT),
    "flying, no machine has room": situation(
        Fly(1, AGENTS), trained(ORDERED), None, Trouble("Unschedulable", "0/4 nodes have room"), STORAGE
    ),
    "all have landed": situation(Fly(1, ("agent-1",)), trained(LANDED)),
    "retraining": situation(Retrain(1, ("1-2", "2")), trained(REPORTED), evaluation(1, 0.8)),
    "retraining after a missed goal": situation(
        Retrain(1, ("1-2", "2")), trained(REPORTED), evaluation(1, 0.6, **{"agent-1": "its battery is empty"}), AGENT
    ),
    "weighing": situation(Weigh(1), trained(EVALUATED), evaluation(1, 0.8)),
    "waiting": situation(Wait(2, 60.0, EPOCH_S + 60), trained(OVER), evaluation(1, 0.8)),
    "suspended before the first mission": situation(Suspended(1), trained()),
    "suspended": situation(Suspended(2), trained(OVER), evaluation(1, 0.8)),
    "flying the second mission": situation(Fly(2, AGENTS), trained(OVER, ORDERED), evaluation(1, 0.8)),
    "every agent failed": situation(
        Failed("every agent failed in mission 1; see their landing.json"),
        trained(EVALUATED),
        evaluation(1, 0.0, **dict.fromkeys(AGENTS, "its battery is empty")),
    ),
    "done": situation(Done(3), trained(OVER, OVER, OVER), evaluation(3, 0.9)),
    "done, goals missed": situation(Done(3), trained(OVER, OVER, OVER), evaluation(3, 0.5)),
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

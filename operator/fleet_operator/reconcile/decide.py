"""The one step that a fleet takes next, from what was observed of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from enum import StrEnum
from typing import Any

from fleet_operator.policy.lifecycle import Course, Failed, MissionProgress, Progress, Step, next_step
from fleet_operator.policy.status import status_of
from fleet_operator.reconcile.flight import Flight, FlightPlan
from fleet_operator.reconcile.observe import Observed, mission_under_way
from fleet_operator.reconcile.seen import Seen
from fleet_operator.resources import names
from fleet_operator.resources.conditions import MissionCondition, Truth
from fleet_operator.resources.roles import Role
from fleet_operator.resources.views import JobState, JobView

_A_MOMENT_S = 1.0
"""Times of a schedule are the first ones after another time."""


class Again(StrEnum):
    """What may be done over, because the user has changed something since it failed."""

    NOTHING = "Nothing"
    MISSION = "Mission"
    EVALUATION = "Evaluation"


@dataclass(frozen=True)
class Decided:
    """What is done next.

    Args:
        step: None when the FleetSpec is refused and nothing is under way.
        plan: What the mission that flies needs; empty when none does.
        given_up: Why aggregators of the mission under way have failed for good, by subset.
        again: What of a mission that came to nothing is done over.
    """

    observed: Observed
    step: Step | None
    progress: Progress
    plan: FlightPlan
    given_up: dict[str, str]
    again: Again = Again.NOTHING

    @property
    def mission(self) -> int:
        """The last mission that was ordered; 0 before the first."""
        return len(self.progress.missions)


def decide(observed: Observed, now_s: float) -> Decided:
    """Decide.

    Args:
        now_s: Seconds since the Unix epoch.

    Raises:
        StorageError: a document cannot be read.
    """
    if observed.flown is None:
        return Decided(observed, None, Progress(now_s=now_s), FlightPlan(), {})
    under_way = mission_under_way(observed.records)
    given_up = _given_up(observed, under_way)
    plan = _plan(observed, under_way)

    def due(number: int) -> frozenset[str]:
        return frozenset(each.subset for each in observed.terms(number) if each.level > 0)

    course = Course.of((observed.asked.flown or observed.flown).fleet)
    reached = observed.records.progress(observed.flown.fleet, due, _broken(observed, under_way) or plan.broken)
    progress = replace(
        reached,
        prepared=_prepared(observed, reached, under_way),
        trained=reached.trained and observed.subsets is not None,
        missions=_with_ends(observed, reached.missions, course, now_s),
        given_up=frozenset(given_up),
        now_s=now_s,
    )
    step = next_step(course, progress)
    return Decided(observed, step, progress, plan, given_up, _again(observed, step, plan))


def _again(observed: Observed, step: Step, plan: FlightPlan) -> Again:
    if not isinstance(step, Failed) or not observed.has_changed:
        return Again.NOTHING
    if plan.broken:
        return Again.EVALUATION
    number = mission_under_way(observed.records)
    evaluation = observed.records.evaluation(number)
    fell = evaluation is not None and set(evaluation.failures).issuperset(observed.agents)
    return Again.MISSION if fell else Again.NOTHING


def _prepared(observed: Observed, reached: Progress, under_way: int) -> bool:
    """Before the first mission, storage follows what is asked for; afterwards an order is what makes it follow."""
    if not reached.prepared or under_way or observed.asked.flown is None:
        return reached.prepared
    if reached.trained and observed.subsets is not None:
        return True
    training = observed.seen.state(names.training_job(observed.seen.ref.name))
    return training is JobState.RUNNING or observed.is_current


def _given_up(observed: Observed, number: int) -> dict[str, str]:
    """Aggregators that have failed, or that ended and left nothing."""
    found: dict[str, str] = {}
    for job in observed.seen.jobs.values():
        if job.role is not Role.AGGREGATOR or job.mission != number or not job.state.over:
            continue
        if observed.paths.retraining(number, job.subset) not in observed.records.objects:
            found[job.subset] = job.message or "it ended without a result"
    return found


def _plan(observed: Observed, number: int) -> FlightPlan:
    records = observed.records
    if not number or observed.paths.evaluation(number) in records.objects:
        return FlightPlan()
    landed = [agent for agent in observed.agents if observed.paths.landing(number, agent) in records.objects]
    failed = [agent for agent in landed if (landing := records.landing(number, agent)) is not None and landing.failed]
    return Flight(observed.seen.ref.name, number, observed.agents, landed, observed.seen.jobs).plan(failed)


def _broken(observed: Observed, number: int) -> str:
    """Why a trainer that all else waits for can never go on; a Job of another order says nothing."""
    fleet, records = observed.seen.ref.name, observed.records
    if number:
        evaluated = observed.paths.evaluation(number) in records.objects
        return _ended(observed, names.weighing_job(fleet, number), f"weighing mission {number}") if evaluated else ""
    trained = observed.paths.reward in records.objects and observed.paths.initial_model in records.objects
    if trained and observed.subsets is not None:
        return ""
    return _ended(observed, names.training_job(fleet), "training")


def _ended(observed: Observed, name: str, what: str) -> str:
    job: JobView | None = observed.seen.jobs.get(name)
    if job is None or not job.state.over or job.order != observed.order:
        return ""
    reason = job.message if job.state is JobState.FAILED else "the trainer ended without a result"
    return f"{what} failed: {reason}; see the log of Job {name}"


def _with_ends(
    observed: Observed, missions: tuple[MissionProgress, ...], course: Course, now_s: float
) -> tuple[MissionProgress, ...]:
    """When the last mission was evaluated: as its Mission object says, else as the FleetSpec's status does, else now.

    A Mission that is gone is made again in the same pass, and says from then on what was found here.
    """
    if not missions or not missions[-1].evaluated:
        return missions
    body = observed.seen.missions.get(len(missions))
    status = body.get("status") if body else None
    ended_s = _evaluated_s(status) if status else None
    if ended_s is None:
        ended_s = min(now_s, _announced_s(observed.seen, len(missions), course, now_s))
    return (*missions[:-1], replace(missions[-1], ended_s=ended_s))


def _announced_s(seen: Seen, number: int, course: Course, now_s: float) -> float:
    """When a mission must have ended for the next one to start when the FleetSpec's status says; else now."""
    status = status_of(seen.body)
    if status is None or not status.next_mission:
        return now_s
    if (status.observed_generation, status.mission) != (seen.generation, number):
        return now_s
    before_s = _A_MOMENT_S if course.schedule else course.interval_s
    return datetime.fromisoformat(status.next_mission).timestamp() - before_s


def _evaluated_s(status: Mapping[str, Any]) -> float | None:
    for condition in status.get("conditions", ()):
        since = condition.get("lastTransitionTime")
        if condition.get("type") == MissionCondition.GOALS_MET and condition.get("status") != Truth.UNKNOWN and since:
            return datetime.fromisoformat(since).timestamp()
    return None

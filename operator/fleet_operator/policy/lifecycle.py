"""What a fleet does next, from what it has reached.

    Prepare -> Train -> Order(1) -> Fly(1) -> Retrain(1) -> Weigh(1) -> Order(2) -> ... -> Done

What is reached is read from storage, never remembered. So a run that was broken off goes on where it was, and doing
a step twice is the same as doing it once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from fleet.spec.base import duration_s
from fleet.spec.resources import Fleet
from fleet.spec.schedule import next_start

LATE_S = 600.0
"""How late a mission may start after the time that its schedule names: it waits for training, or for the operator."""


@dataclass(frozen=True)
class Course:
    """What the FleetSpec asks for.

    Args:
        agents: Names of the agents.
        missions: How many missions are flown.
        retrain_every: Aggregators run after every so many missions.
        interval_s: Time from the end of a mission to the start of the next.
        suspended: No new mission is ordered; one that was ordered goes on to its weighing.
        schedule: When missions start, as cron writes it, in UTC; "" when the interval says it. Then the clock of
            `Progress` must be seconds since the Unix epoch.
    """

    agents: tuple[str, ...]
    missions: int
    retrain_every: int = 1
    interval_s: float = 0.0
    suspended: bool = False
    schedule: str = ""

    @staticmethod
    def of(fleet: Fleet) -> Course:
        """The course of a FleetSpec."""
        return Course(
            agents=tuple(agent.name for agent in fleet.agents.resolved),
            missions=fleet.missions.count,
            retrain_every=fleet.online_learning.retraining.every,
            interval_s=duration_s(fleet.missions.interval),
            suspended=fleet.suspend,
            schedule=fleet.missions.schedule or "",
        )


@dataclass(frozen=True)
class MissionProgress:
    """What a mission has reached.

    Args:
        ordered: Its plan.json is there.
        landed: Agents whose landing.json is there.
        failed: Those of them that failed.
        evaluated: Its evaluation.json is there.
        due: Subsets whose aggregators are to run after it: of a level above 0, not pruned.
        retrained: Subsets whose retraining report is there.
        weighed: The weights of the next mission are there.
        ended_s: When it was evaluated, on the same clock as `Progress.now_s`; None when that is not known.
    """

    ordered: bool = False
    landed: frozenset[str] = frozenset()
    failed: frozenset[str] = frozenset()
    evaluated: bool = False
    due: frozenset[str] = frozenset()
    retrained: frozenset[str] = frozenset()
    weighed: bool = False
    ended_s: float | None = None


@dataclass(frozen=True)
class Progress:
    """What a fleet has reached.

    Args:
        prepared: The FleetSpec and all contexts are in storage.
        trained: The reward and the initial model are in storage.
        missions: Missions 1, 2, ... as far as there is anything of them.
        given_up: Subsets whose aggregators failed for good after the mission that is under way: not waited for.
        broken: Why a role that all else waits for can never go on; "" when none is broken.
        now_s: The time.
    """

    prepared: bool = False
    trained: bool = False
    missions: tuple[MissionProgress, ...] = ()
    given_up: frozenset[str] = frozenset()
    broken: str = ""
    now_s: float = 0.0


@dataclass(frozen=True)
class Prepare:
    """Copy the FleetSpec and its contexts into storage."""


@dataclass(frozen=True)
class Train:
    """Shape the reward and train the first model."""


@dataclass(frozen=True)
class Order:
    """Write a mission's plan, and for the first mission its weights."""

    number: int


@dataclass(frozen=True)
class Wait:
    """Let time pass before the next mission.

    Args:
        seconds: How long.
        until_s: Until when, on the clock of `Progress.now_s`; the same each time that it is asked for.
    """

    number: int
    seconds: float
    until_s: float = 0.0


@dataclass(frozen=True)
class Fly:
    """Have the sensors and workflows of these agents running until the mission is evaluated.

    When all have landed and nobody has evaluated, it is one agent's: its workflow evaluates when it is started again.
    """

    number: int
    agents: tuple[str, ...]


@dataclass(frozen=True)
class Retrain:
    """Have the aggregators of these subsets running until they have reported."""

    number: int
    subsets: tuple[str, ...]


@dataclass(frozen=True)
class Weigh:
    """Find weights and usefulness after a mission."""

    number: int


@dataclass(frozen=True)
class Suspended:
    """Nothing, until the FleetSpec is resumed with this mission."""

    number: int


@dataclass(frozen=True)
class Failed:
    """Nothing ever again, unless the user changes something."""

    reason: str


@dataclass(frozen=True)
class Done:
    """Nothing: all missions were flown."""

    missions: int


Step = Prepare | Train | Order | Wait | Fly | Retrain | Weigh | Suspended | Failed | Done


def next_step(course: Course, progress: Progress) -> Step:
    """The one step that a fleet takes next."""
    if progress.broken:
        return Failed(progress.broken)
    if not progress.prepared:
        return Prepare()
    if not progress.trained:
        return Train()
    for number, mission in enumerate(progress.missions, start=1):
        step = _mission_step(course, number, mission, progress.given_up)
        if step is not None:
            return step
    return _next_mission(course, progress)


def _mission_step(course: Course, number: int, mission: MissionProgress, given_up: frozenset[str]) -> Step | None:
    """What a mission still needs; None when it is over."""
    if not mission.ordered:
        return Suspended(number) if course.suspended else Order(number)
    if not mission.evaluated:
        flying = tuple(agent for agent in course.agents if agent not in mission.landed)
        return Fly(number, flying or course.agents[:1])
    if mission.failed.issuperset(course.agents):
        return Failed(f"every agent failed in mission {number}; see their landing.json")
    missing = mission.due - mission.retrained - given_up
    if missing and number % course.retrain_every == 0 and not mission.weighed:
        return Retrain(number, tuple(sorted(missing)))
    return None if mission.weighed else Weigh(number)


def _next_mission(course: Course, progress: Progress) -> Step:
    number = len(progress.missions) + 1
    if number > course.missions:
        return Done(len(progress.missions))
    if course.suspended:
        return Suspended(number)
    ended_s = progress.missions[-1].ended_s if progress.missions else None
    due_s = _scheduled_s(course, progress, ended_s) if course.schedule else _after_interval_s(course, progress, ended_s)
    if due_s is None:
        return Failed(f"spec.missions.schedule has no time any more for mission {number}: {course.schedule}")
    return Wait(number, due_s - progress.now_s, due_s) if due_s > progress.now_s else Order(number)


def _after_interval_s(course: Course, progress: Progress, ended_s: float | None) -> float:
    """When the interval is over; never longer from now than the interval, whatever the clock was when it began."""
    if ended_s is None:
        return progress.now_s
    return min(ended_s, progress.now_s) + course.interval_s


def _scheduled_s(course: Course, progress: Progress, ended_s: float | None) -> float | None:
    """The first time of the schedule after the last mission; one that was missed by more than `LATE_S` is left out."""
    since_s = progress.now_s - LATE_S
    return next_start(course.schedule, since_s if ended_s is None else max(ended_s, since_s))


def phase(step: Step) -> str:  # noqa: PLR0911 - one word for each kind of step
    """The phase of a fleet that takes this step next, as one word for people."""
    match step:
        case Prepare():
            return "Preparing"
        case Train():
            return "Training"
        case Order() | Fly():
            return "Flying"
        case Retrain():
            return "Retraining"
        case Weigh():
            return "Weighing"
        case Wait():
            return "Waiting"
        case Suspended():
            return "Suspended"
        case Failed():
            return "Failed"
        case Done():
            return "Done"
    assert_never(step)

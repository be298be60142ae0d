from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from fleet.spec.platform import MissionPlan
from fleet.spec.resources import Fleet
from fleet.spec.schedule import next_start
from fleet.storage.layout import FleetPaths
from fleet_operator.policy.lifecycle import (
    Course,
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
    next_step,
    phase,
)
from fleet_operator.policy.progress import is_trained, missions_so_far

AGENTS = ("a", "b")
COURSE = Course(AGENTS, missions=2)
DUE = frozenset({"1", "1-2"})
OVER = MissionProgress(True, frozenset(AGENTS), frozenset(), True, DUE, DUE, True, ended_s=100.0)
READY = Progress(prepared=True, trained=True)


def after(*missions: MissionProgress, now_s: float = 0.0) -> Progress:
    return replace(READY, missions=missions, now_s=now_s)


def do(step: Step, progress: Progress) -> Progress:
    """What a fleet has reached when a step has succeeded."""
    match step:
        case Prepare():
            return replace(progress, prepared=True)
        case Train():
            return replace(progress, trained=True)
        case Order():
            return replace(progress, missions=(*progress.missions, MissionProgress(ordered=True)))
        case Wait(seconds=seconds):
            return replace(progress, now_s=progress.now_s + seconds)
        case _:
            return replace(progress, missions=(*progress.missions[:-1], fly_on(step, progress)))


def fly_on(step: Step, progress: Progress) -> MissionProgress:
    mission = progress.missions[-1]
    match step:
        case Fly(agents=agents):
            landed = mission.landed | set(agents)
            return replace(mission, landed=landed, evaluated=True, due=DUE, ended_s=progress.now_s)
        case Retrain(subsets=subsets):
            return replace(mission, retrained=mission.retrained | set(subsets))
        case Weigh():
            return replace(mission, weighed=True)
    raise AssertionError(step)


def steps_to_the_end(course: Course, progress: Progress) -> list[Step]:
    steps: list[Step] = []
    while not isinstance(step := next_step(course, progress), Done | Failed | Suspended):
        steps.append(step)
        progress = do(step, progress)
        assert len(steps) < 1000
    return [*steps, step]


def test_a_fleet_goes_through_its_missions_in_order() -> None:
    both = ("1", "1-2")
    assert steps_to_the_end(COURSE, Progress()) == [
        Prepare(), Train(),
        Order(1), Fly(1, AGENTS), Retrain(1, both), Weigh(1),
        Order(2), Fly(2, AGENTS), Retrain(2, both), Weigh(2),
        Done(2),
    ]  # fmt: skip


def test_aggregators_run_after_every_so_many_missions_and_weighing_after_each() -> None:
    steps = steps_to_the_end(replace(COURSE, missions=5, retrain_every=2), READY)
    assert [step.number for step in steps if isinstance(step, Retrain)] == [2, 4]
    assert [step.number for step in steps if isinstance(step, Weigh)] == [1, 2, 3, 4, 5]


def test_only_what_is_missing_is_done() -> None:
    flying = MissionProgress(ordered=True, landed=frozenset({"a"}))
    assert next_step(COURSE, after(flying)) == Fly(1, ("b",))
    learning = replace(OVER, weighed=False, retrained=frozenset({"1"}))
    assert next_step(COURSE, after(learning)) == Retrain(1, ("1-2",))
    assert next_step(COURSE, after(replace(learning, due=frozenset()))) == Weigh(1)


def test_one_agent_is_started_again_when_all_have_landed_and_nobody_has_evaluated() -> None:
    assert next_step(COURSE, after(MissionProgress(True, frozenset(AGENTS)))) == Fly(1, ("a",))


def test_time_passes_between_missions() -> None:
    course = replace(COURSE, interval_s=60.0)
    assert next_step(course, after(OVER, now_s=130.0)) == Wait(2, 30.0, 160.0)
    assert next_step(course, after(OVER, now_s=160.0)) == Order(2)
    assert next_step(course, after(replace(OVER, ended_s=None), now_s=130.0)) == Order(2)


SIX = 1_785_564_000.0
"""2026-08-01, a Saturday, 06:00 UTC."""
DAY = 86_400.0
DAILY = replace(COURSE, schedule="0 6 * * *")


def test_missions_start_at_the_times_of_their_schedule() -> None:
    assert next_step(DAILY, after(now_s=SIX - 60)) == Wait(1, 60.0, SIX)
    assert next_step(DAILY, after(now_s=SIX)) == Order(1)
    ended = replace(OVER, ended_s=SIX + 300)
    assert next_step(DAILY, after(ended, now_s=SIX + 301)) == Wait(2, DAY - 301, SIX + DAY)
    assert next_step(DAILY, after(ended, now_s=SIX + DAY)) == Order(2)
    working = replace(COURSE, schedule="0 6 * * mon-fri")
    assert next_step(working, after(now_s=SIX)) == Wait(1, 2 * DAY, SIX + 2 * DAY)


def test_a_start_that_was_missed_by_more_than_ten_minutes_is_left_out() -> None:
    assert next_step(DAILY, after(now_s=SIX + 599)) == Order(1)
    assert next_step(DAILY, after(now_s=SIX + 601)) == Wait(1, DAY - 601, SIX + DAY)


def test_a_mission_that_lasts_longer_than_the_schedule_leaves_a_start_out() -> None:
    hourly = replace(COURSE, schedule="0 * * * *")
    ended = replace(OVER, ended_s=SIX + 4000)
    assert next_step(hourly, after(ended, now_s=SIX + 4000)) == Wait(2, 3200.0, SIX + 7200)


def test_a_schedule_that_is_suspended_or_flown_waits_for_nothing() -> None:
    assert next_step(replace(DAILY, suspended=True), after(now_s=SIX)) == Suspended(1)
    assert next_step(DAILY, after(OVER, OVER, now_s=SIX)) == Done(2)


FIELDS = ("0 30 */15 5-50/5 1,2,58", "6 */2 0-23 9,17", "* 1 28 */3 10-20", "* 1 jan-mar 12 */2", "* 0 7 mon-fri sun")
SCHEDULES = st.tuples(*(st.sampled_from(field.split()) for field in FIELDS)).map(" ".join)


@given(SCHEDULES, st.floats(SIX, SIX + 400 * DAY), st.floats(0, 3 * DAY) | st.none())
def test_every_scheduled_start_is_on_the_schedule_and_after_the_last_mission(
    schedule: str, now_s: float, ago_s: float | None
) -> None:
    ended = replace(OVER, ended_s=None if ago_s is None else now_s - ago_s)
    step = next_step(replace(COURSE, schedule=schedule), after(ended, now_s=now_s))
    match step:
        case Wait(number=2, seconds=seconds, until_s=until_s):
            assert seconds > 0
            assert until_s % 60 == 0
            assert abs(now_s + seconds - until_s) < 1e-6
            assert next_start(schedule, until_s - 60) == until_s
            later = next_step(replace(COURSE, schedule=schedule), after(ended, now_s=until_s))
            assert later == Order(2)
        case _:
            assert step == Order(2)
            assert (next_start(schedule, now_s - 600) or 0) <= now_s


def test_a_suspended_fleet_ends_its_mission_and_orders_none() -> None:
    course = replace(COURSE, suspended=True)
    ends = [step for step in steps_to_the_end(course, after(MissionProgress(ordered=True))) if step != Weigh(1)]
    assert ends == [Fly(1, AGENTS), Retrain(1, ("1", "1-2")), Suspended(2)]
    assert steps_to_the_end(course, Progress()) == [Prepare(), Train(), Suspended(1)]
    assert next_step(course, after(OVER, OVER)) == Done(2)


def test_a_fleet_fails_when_a_role_is_broken_or_every_agent_failed() -> None:
    assert next_step(COURSE, replace(READY, broken="no context")) == Failed("no context")
    one, both = frozenset({"a"}), frozenset(AGENTS)
    assert next_step(COURSE, after(replace(OVER, failed=one))) == Order(2)
    assert isinstance(next_step(COURSE, after(replace(OVER, failed=both))), Failed)


def test_missions_that_were_flown_count_when_fewer_are_asked_for_later() -> None:
    assert next_step(replace(COURSE, missions=1), after(OVER, OVER)) == Done(2)
    assert next_step(replace(COURSE, missions=3), after(OVER, OVER)) == Order(3)


@given(st.integers(1, 6), st.integers(1, 3), st.data())
def test_a_run_that_is_broken_off_anywhere_goes_on_with_the_same_steps(
    missions: int, every: int, data: st.DataObject
) -> None:
    course = Course(AGENTS, missions, every)
    steps = steps_to_the_end(course, Progress())
    cut = data.draw(st.integers(0, len(steps) - 1))
    progress = Progress()
    for step in steps[:cut]:
        progress = do(step, progress)
    assert steps_to_the_end(course, progress) == steps[cut:]
    assert phase(next_step(course, progress))


def test_the_course_is_read_from_the_fleet_spec() -> None:
    fleet = Fleet.model_validate(
        {
            "agents": {"count": 2},
            "stateSpace": {"context": "c"},
            "map": {"function": "a:b"},
            "eval": {"function": "a:b"},
            "contexts": [{"name": "c", "uri": "c", "use": ["Shaping", "Training", "Mission"]}],
            "goals": [{"metric": "accuracy", "atLeast": 0.7}],
            "onlineLearning": {"retraining": {"every": 3}},
            "missions": {"count": 7, "interval": "1m30s"},
            "suspend": True,
        }
    )
    assert Course.of(fleet) == Course(("agent-1", "agent-2"), 7, 3, 90.0, True)
    scheduled = fleet.model_copy(update={"missions": MissionPlan(schedule="0 6 * * *")})
    assert Course.of(scheduled).schedule == "0 6 * * *"


def test_progress_is_read_from_the_names_of_objects() -> None:
    paths = FleetPaths("default", "crop")
    objects = {
        paths.reward, paths.initial_model, paths.weights(1),
        paths.plan(1), paths.landing(1, "a"), paths.landing(1, "b"), paths.landing(1, "stranger"), paths.evaluation(1),
        paths.retraining(1, "1"), paths.weights(2), paths.plan(2), paths.landing(2, "b"),
        FleetPaths("default", "crop-2").plan(3),
    }  # fmt: skip
    assert is_trained(paths, objects)
    assert not is_trained(paths, objects - {paths.reward})
    found = missions_so_far(paths, objects, AGENTS, due=lambda number: DUE, failed=lambda number: frozenset("b"))
    assert found == (
        MissionProgress(True, frozenset("ab"), frozenset("b"), True, DUE, frozenset({"1"}), True),
        MissionProgress(True, frozenset("b")),
    )
    assert missions_so_far(paths, set(), AGENTS, due=lambda number: DUE) == ()

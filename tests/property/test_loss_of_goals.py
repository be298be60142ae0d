from __future__ import annotations

import math

from hypothesis import assume, given
from hypothesis import strategies as st

from fleet.learning.goals import PENALTY, Objective
from fleet.missions.documents import judge
from fleet.spec.swarm import Goal

values = st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.floats(-2.0, 2.0))
targets = st.floats(-1e6, 1e6)
goals = st.builds(
    lambda metric, low, target, weight: Goal(
        metric=metric, at_least=target if low else None, at_most=None if low else target, weight=weight
    ),
    st.sampled_from(["accuracy", "time_s"]),
    st.booleans(),
    targets,
    st.floats(0.01, 100.0),
)
evaluations = st.dictionaries(st.sampled_from(["accuracy", "time_s", "uav_energy_j"]), values, max_size=3)
objectives = st.builds(
    Objective,
    goals=st.lists(goals, min_size=1, max_size=3).map(tuple),
    minimise=st.sampled_from(["uav_energy_j", "time_s", ""]),
    margin=st.floats(0.0, 0.5),
    contexts=st.integers(1, 4),
)


@given(objectives, evaluations)
def test_a_mission_without_margin_meets_its_goals_exactly_when_judged_so(
    objective: Objective, metrics: dict[str, float]
) -> None:
    assume(not any(math.isinf(value) for value in metrics.values()))  # refused where Eval() answers
    finite = {name: value for name, value in metrics.items() if not math.isnan(value)}
    assert objective.met(metrics) == all(result.met for result in judge(objective.goals, finite))


@given(objectives, st.data())
def test_meeting_every_goal_everywhere_is_always_better_than_missing_one(
    objective: Objective, data: st.DataObject
) -> None:
    several = st.lists(evaluations, min_size=objective.contexts, max_size=objective.contexts)
    one, other = data.draw(several), data.draw(several)

    def total(missions: list[dict[str, float]]) -> float:
        return sum(objective.loss(metrics, 1000.0) for metrics in missions)

    def misses(missions: list[dict[str, float]]) -> bool:
        return any(objective.miss(goal, metrics) > 0.0 for metrics in missions for goal in objective.goals)

    assert misses(one) == (total(one) > 1.0)
    if not misses(one) and misses(other):
        assert total(one) < total(other)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 0.2))
def test_the_further_a_goal_is_missed_the_greater_is_the_loss(one: float, other: float, margin: float) -> None:
    objective = Objective((Goal(metric="accuracy", at_least=0.7),), "uav_energy_j", margin)
    losses = [objective.loss({"accuracy": value, "uav_energy_j": 1.0}) for value in sorted((one, other))]
    assert losses[0] >= losses[1]


@given(st.floats(0.0, 1e9), st.floats(0.0, 1e9), st.floats(1.0, 1e9))
def test_among_missions_that_meet_the_goals_the_cheaper_is_better(one: float, other: float, reference: float) -> None:
    objective = Objective((Goal(metric="accuracy", at_least=0.7),), "uav_energy_j")
    losses = [objective.loss({"accuracy": 0.9, "uav_energy_j": value}, reference) for value in sorted((one, other))]
    assert losses[0] <= losses[1]


def test_a_metric_that_is_missing_or_not_a_number_misses_its_goal_fully() -> None:
    objective = Objective((Goal(metric="accuracy", at_least=0.7, weight=3.0),))
    assert objective.loss({}) == objective.loss({"accuracy": math.nan}) == 4.0
    assert objective.loss({"accuracy": -1e300}) <= 4.0


def test_a_goal_that_is_met_without_its_margin_is_a_small_miss() -> None:
    objective = Objective((Goal(metric="accuracy", at_least=0.7),), margin=0.02)
    assert objective.met({"accuracy": 0.7})
    assert 1.0 < objective.loss({"accuracy": 0.7}) < 1.02
    assert objective.loss({"accuracy": 0.7141}) < 1.0


def test_the_cost_is_a_share_of_visiting_everything() -> None:
    objective = Objective((), "uav_energy_j")
    assert objective.loss({"uav_energy_j": 500.0}, 1000.0) == 0.25 + 0.75 * 0.5 / 1.5
    assert objective.loss({"uav_energy_j": -500.0}, 1000.0) == 0.25 / 1.5
    assert objective.loss({"uav_energy_j": 5.0}, math.nan) == objective.loss({"uav_energy_j": 5.0}, 1.0)


@given(objectives, evaluations)
def test_the_guide_of_an_optimiser_is_the_loss_when_goals_are_met_and_finite_always(
    objective: Objective, metrics: dict[str, float]
) -> None:
    guide = objective.guide(metrics, 1000.0)
    assert math.isfinite(guide)
    if all(objective.miss(goal, metrics) == 0.0 for goal in objective.goals):
        assert guide == objective.loss(metrics, 1000.0)


def test_the_guide_has_no_jump_where_a_goal_is_missed() -> None:
    objective = Objective((Goal(metric="accuracy", at_least=0.8),), "uav_energy_j")
    met, missed = ({"accuracy": accuracy, "uav_energy_j": 400.0} for accuracy in (0.8, 0.8 - 1e-6))
    assert objective.loss(missed, 1000.0) - objective.loss(met, 1000.0) > 0.4
    assert abs(objective.guide(missed, 1000.0) - objective.guide(met, 1000.0)) < 2e-6 * PENALTY

"""The searches that reward shaping is compared with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from bench.shaping import OURS, RANDOM, SKOPT, PaperRange, RandomSearch, dimensions_of, look
from fleet.learning.bayes import Point
from fleet.learning.reward import Normaliser
from fleet.learning.run import references
from fleet.learning.shaping import Problem, Trial, evaluate, reward_of
from tests.learning_field import FEATURES, field_fleet, field_grounds


def problem() -> Problem:
    fleet = field_fleet(rewardShaping={"epochs": 20, "batch": 4, "missions": 4})
    grounds = field_grounds(fleet)
    normaliser = Normaliser.over([terrain.ssv for terrain in grounds.terrains])
    return Problem(fleet, grounds, normaliser, references(fleet, grounds), 0, None)


class Noted:
    """Asks for one point, and keeps what it is told."""

    def __init__(self, point: Point) -> None:
        self.point = point
        self.told: list[tuple[Point, float]] = []

    def ask(self, count: int) -> list[Point]:
        return [self.point] * count

    def tell(self, points: Sequence[Point], guides: Sequence[float]) -> None:
        self.told += zip(points, guides, strict=True)


def test_in_the_range_of_the_paper_the_utility_threshold_is_what_the_search_asked_for() -> None:
    inner = Noted((1.0, 0.5, 0.0, 2.5, 4))
    search = PaperRange(problem(), lambda ranges: inner)
    [point] = search.ask(1)
    reward = reward_of(field_fleet(), FEATURES, problem().normaliser, Trial(0, point, 0.0, False))
    assert reward.utility_threshold == pytest.approx(2.5)
    search.tell([point], [0.4])
    assert inner.told == [(inner.point, 0.4)]


def test_random_search_draws_every_value_from_its_range_evenly() -> None:
    dimensions = dimensions_of(problem())
    points = RandomSearch(dimensions, seed=1).ask(2000)
    assert all(d.holds(value) for point in points for d, value in zip(dimensions, point, strict=True))
    places = np.array([[d.place_of(value) for d, value in zip(dimensions, point, strict=True)] for point in points])
    np.testing.assert_allclose(places.mean(axis=0), 0.5, atol=0.03)


@pytest.mark.parametrize("name", [OURS, RANDOM, SKOPT])
def test_a_search_is_the_same_for_a_seed_and_counts_what_met_the_goal(name: str) -> None:
    one, other = (look(problem(), name, seed=3) for _ in range(2))
    assert (one.half, one.whole, one.met) == (other.half, other.whole, other.met)
    assert one.whole <= one.half
    assert (one.whole < 1.0) == (one.met > 0.0)
    assert 0.0 <= one.overhead < 1.0


def test_what_optimisers_are_told_is_the_loss_where_the_goal_is_met_and_has_no_jump_elsewhere() -> None:
    trials = [evaluate(problem(), (0, point)) for point in RandomSearch(dimensions_of(problem()), 2).ask(40)]
    met = [trial for trial in trials if trial.loss < 1.0]
    missed = [trial for trial in trials if trial.loss > 1.0]
    assert met
    assert missed
    assert [trial.guide for trial in met] == pytest.approx([trial.loss for trial in met])
    assert min(trial.guide for trial in missed) < 1.0

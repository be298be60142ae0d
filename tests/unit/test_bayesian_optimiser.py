from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from fleet.errors import TrainingError
from fleet.learning.bayes import (
    LENGTHS,
    NEAR,
    SAMPLES,
    Dimension,
    Optimiser,
    Point,
    batch_of_improvements,
    candidates,
    expected_improvement,
)

SPACE = (
    Dimension("x", 0.0, 1.0),
    Dimension("given", 0.3, 0.3),
    Dimension("y", -2.0, 5.0),
    Dimension("n", 0, 8, integer=True),
)


def bowl(point: Point) -> float:
    x, _, y, n = point
    return (x - 0.3) ** 2 + (y - 1.0) ** 2 / 20 + (n - 3) ** 2 / 30


def history(optimiser: Optimiser, batches: int, size: int = 4) -> list[Point]:
    asked: list[Point] = []
    for _ in range(batches):
        points = optimiser.ask(size)
        optimiser.tell(points, [bowl(point) for point in points])
        asked += points
    return asked


def test_every_point_is_in_the_space_and_whole_numbers_are_whole() -> None:
    for x, fixed, y, n in history(Optimiser(SPACE, seed=1, initial=6), 4):
        assert 0.0 <= x <= 1.0
        assert fixed == 0.3
        assert -2.0 <= y <= 5.0
        assert n in range(9)
        assert isinstance(n, int)


@pytest.mark.parametrize("seed", range(4))
def test_it_finds_the_bottom_of_a_bowl(seed: int) -> None:
    optimiser = Optimiser(SPACE, seed=seed, initial=8)
    history(optimiser, 8)
    generator = np.random.default_rng(seed)
    by_chance = min(bowl(optimiser.point_at(place)) for place in generator.random((32, 3)))
    assert min(optimiser.losses) < min(0.02, by_chance)


DIMENSIONS = (
    Dimension("x", -2.0, 5.0),
    Dimension("n", -3, 8, integer=True),
    Dimension("share", 1 / 32, 1.0, logarithmic=True),
)


@given(st.sampled_from(DIMENSIONS), st.floats(0.0, 1.0))
def test_a_place_in_the_unit_interval_is_a_value_in_the_range_and_back(dimension: Dimension, place: float) -> None:
    value = dimension.value_at(place)
    assert dimension.holds(value)
    assert dimension.value_at(dimension.place_of(value)) == pytest.approx(value)
    if not dimension.integer:
        assert dimension.place_of(value) == pytest.approx(place, abs=1e-9)


def test_whole_numbers_are_equally_likely_and_ratios_take_equal_room() -> None:
    places = (np.arange(1200) + 0.5) / 1200
    values = [DIMENSIONS[1].value_at(place) for place in places.tolist()]
    assert [values.count(number) for number in range(-3, 9)] == [100] * 12
    assert DIMENSIONS[2].value_at(0.4) == pytest.approx(1 / 8)


def test_a_logarithmic_range_starts_above_0() -> None:
    with pytest.raises(TrainingError, match=r"share: 0..1 cannot be logarithmic; start above 0"):
        Dimension("share", 0, 1, logarithmic=True)


def test_a_batch_is_what_asking_one_by_one_with_the_least_loss_as_a_lie_would_give() -> None:
    generator = np.random.default_rng(3)
    seen, places = generator.random((12, 2)), generator.random((80, 2))
    losses = ((seen - 0.4) ** 2).sum(axis=1)
    together = batch_of_improvements(seen, losses, places, 3)
    assert len(set(together)) == 3
    one = batch_of_improvements(seen, losses, places, 1)
    two = batch_of_improvements(np.concatenate([seen, places[one]]), losses, places, 1)
    assert together[:2] == [*one, *two]


def test_candidates_are_in_the_unit_cube_and_some_differ_from_a_best_point_in_one_value() -> None:
    best = np.array([[0.0, 1.0, 0.5], [0.2, 0.3, 0.4]])
    found = candidates(best, np.random.default_rng(1))
    assert found.shape == (SAMPLES + 2 * NEAR, 3)
    assert ((found >= 0.0) & (found <= 1.0)).all()
    assert ((found[-NEAR:] != best[1]).sum(axis=1) == 1).sum() > NEAR // 10


def test_one_that_is_made_anew_and_told_the_history_asks_for_the_same() -> None:
    whole = Optimiser(SPACE, seed=3, initial=6)
    asked = history(whole, 4)
    anew = Optimiser(SPACE, seed=3, initial=6)
    anew.tell(asked, [bowl(point) for point in asked])
    assert anew.ask(3) == whole.ask(3) == whole.ask(3)


def test_another_seed_asks_for_other_points() -> None:
    assert Optimiser(SPACE, seed=1).ask(2) != Optimiser(SPACE, seed=2).ask(2)


def test_given_points_come_first() -> None:
    start = (0.5, 0.3, 0.0, 4)
    optimiser = Optimiser(SPACE, seed=1, initial=5, first=[start])
    asked = history(optimiser, 1, size=5)
    assert asked[0] == start
    assert len(set(asked)) == 5


def test_what_is_known_from_elsewhere_guides_but_does_not_replace_the_first_points() -> None:
    plain, knowing = (Optimiser(SPACE, seed=1, initial=4) for _ in range(2))
    points = history(Optimiser(SPACE, seed=9, initial=6), 2)
    knowing.know(points, [bowl(point) for point in points])
    assert knowing.ask(4) == plain.ask(4)
    assert knowing.ask(5)[:4] == plain.ask(4)


def test_with_nothing_free_it_asks_for_the_one_point_there_is() -> None:
    fixed = Optimiser([Dimension("a", 0.5, 0.5), Dimension("n", 2, 2, integer=True)], seed=1)
    assert fixed.ask(2) == [(0.5, 2)] * 2


def test_a_space_of_two_points_can_be_asked_again_and_again() -> None:
    optimiser = Optimiser([Dimension("n", 0, 1, integer=True)], seed=1, initial=2)
    for _ in range(4):
        points = optimiser.ask(2)
        optimiser.tell(points, [float(point[0]) for point in points])
    assert set(optimiser.points) == {(0,), (1,)}


def test_equal_losses_everywhere_are_no_trouble() -> None:
    optimiser = Optimiser(SPACE, seed=1, initial=4)
    for _ in range(3):
        points = optimiser.ask(3)
        optimiser.tell(points, [1.0] * 3)
    assert len(optimiser.points) == 9


def test_what_is_told_must_be_a_point_with_a_finite_loss() -> None:
    optimiser = Optimiser(SPACE, seed=1)
    with pytest.raises(TrainingError, match="is not a point of x, given, y, n"):
        optimiser.tell([(2.0, 0.3, 0.0, 1)], [0.0])
    with pytest.raises(TrainingError, match="must be a finite number"):
        optimiser.tell([(0.5, 0.3, 0.0, 1)], [math.nan])
    with pytest.raises(TrainingError, match="is not a range"):
        Dimension("x", 1.0, 0.0)


def test_improvement_is_expected_between_the_lows_and_not_at_the_high() -> None:
    points = np.array([[0.0], [0.4], [0.6], [1.0]])
    losses = np.array([1.0, 0.2, 0.2, 1.0])
    gain = expected_improvement(points, losses, np.full(4, 1e-3), np.array([[0.0], [0.5], [1.0]]), seed=0)
    assert gain.shape == (3,)
    assert (gain >= 0.0).all()
    assert gain[1] > 10 * max(gain[0], gain[2])


def test_a_noisy_low_promises_less_than_a_sure_one() -> None:
    points = np.array([[0.1], [0.2], [0.8], [0.9], [0.5]])
    losses = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
    sure_left = np.array([0.01, 0.01, 2.0, 2.0, 0.01])
    gain = expected_improvement(points, losses - [0.5, 0.5, 0.5, 0.5, 0.0], sure_left, np.array([[0.15], [0.85]]), 0)
    mirrored = expected_improvement(
        points, losses - [0.5, 0.5, 0.5, 0.5, 0.0], sure_left[[2, 3, 0, 1, 4]], np.array([[0.85], [0.15]]), 0
    )
    np.testing.assert_allclose(gain, mirrored, rtol=1e-3, atol=1e-6)


def test_expected_improvement_is_the_same_for_a_seed_and_defined_for_one_observation() -> None:
    generator = np.random.default_rng(1)
    points, candidates = generator.random((6, 3)), generator.random((50, 3))
    losses, noise = points.sum(axis=1), np.full(6, 0.1)
    one, other = (expected_improvement(points, losses, noise, candidates, 5) for _ in range(2))
    np.testing.assert_array_equal(one, other)
    alone = expected_improvement(points[:1], losses[:1], noise[:1], candidates, 5)
    assert np.isfinite(alone).all()


def one_by_one(seen: np.ndarray, losses: np.ndarray, places: np.ndarray, count: int) -> list[int]:
    """The naive form: the noise is a parameter like the others, and each choice solves for all that is open."""
    scaled = (losses - losses.mean()) / losses.std()
    shape = ConstantKernel(1.0, (0.05, 20.0)) * Matern(np.full(seen.shape[1], 0.5), LENGTHS)
    fitted = GaussianProcessRegressor(shape + WhiteKernel(), alpha=1e-6).fit(seen, scaled).kernel_
    chosen: list[int] = []
    for _ in range(count):
        points = np.concatenate([seen, places[chosen]])
        told = np.concatenate([scaled, np.full(len(chosen), scaled.min())])
        across = fitted.k1(places, points)
        solved = np.linalg.solve(fitted(points) + 1e-6 * np.eye(len(points)), np.column_stack([told, across.T]))
        mean, variance = across @ solved[:, 0], fitted.k1.diag(places) - (across * solved[:, 1:].T).sum(axis=1)
        deviation = np.sqrt(variance)
        z = (scaled.min() - mean) / deviation
        chosen.append(int(np.argmax((scaled.min() - mean) * norm.cdf(z) + deviation * norm.pdf(z))))
    return chosen


@pytest.mark.parametrize("seed", range(3))
def test_every_point_of_a_batch_is_chosen_with_the_noise_that_was_fitted(seed: int) -> None:
    generator = np.random.default_rng(seed)
    seen, places = generator.random((40, 2)), generator.random((200, 2))
    losses = ((seen - 0.4) ** 2).sum(axis=1) + 0.1 * generator.normal(size=40)
    assert batch_of_improvements(seen, losses, places, 4) == one_by_one(seen, losses, places, 4)

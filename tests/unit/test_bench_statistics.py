"""Differences of benchmarks, with their intervals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from bench.statistics import interval, paired
from tests.conftest import ROOT


def test_intervals_are_those_of_the_t_distribution_for_normal_values() -> None:
    values = np.random.default_rng(3).normal(0.02, 0.01, 200)
    found = interval(values)
    low, high = stats.t.interval(0.95, 199, values.mean(), stats.sem(values))
    assert (found.mean, found.low, found.high) == pytest.approx((values.mean(), low, high), abs=1e-4)
    mirrored = interval(-values)
    assert (mirrored.low, mirrored.high) == pytest.approx((-found.high, -found.low), abs=1e-4)
    assert found.certain


@pytest.mark.parametrize("skewed", [False, True])
def test_intervals_of_ten_seeds_hold_the_true_mean_as_often_as_they_say(skewed: bool) -> None:
    generator = np.random.default_rng(4)
    draw = generator.exponential if skewed else (lambda mean, count: generator.normal(mean, 1.0, count))
    trials = [draw(1.0, 10) for _ in range(300)]
    held = np.mean([(found := interval(values)).low <= 1.0 <= found.high for values in trials])
    plain = [stats.bootstrap((values,), np.mean, n_resamples=499, method="BCa", rng=1) for values in trials[:150]]
    held_by_bca = np.mean([each.confidence_interval.low <= 1.0 <= each.confidence_interval.high for each in plain])
    assert 0.92 <= held <= 0.98
    assert held > held_by_bca


def test_one_seed_that_is_unlike_all_others_makes_the_interval_wide_but_not_endless() -> None:
    values = np.append(np.random.default_rng(6).normal(0.0, 1e-4, 9), 0.1)
    found = interval(values)
    assert 0.03 < found.high < 0.1
    assert -0.01 < found.low < 0.002


def test_with_few_seeds_the_interval_is_that_of_the_t_distribution() -> None:
    values = np.array([0.1, 0.3, 0.2])
    found = interval(values)
    assert (found.low, found.high) == pytest.approx(stats.t.interval(0.95, 2, values.mean(), stats.sem(values)))
    assert not interval(values[:1]).certain


def test_pairs_take_out_what_seeds_have_in_common() -> None:
    generator = np.random.default_rng(5)
    hard = generator.normal(0, 1.0, 10)
    found = paired(hard + 0.1 + generator.normal(0, 0.01, 10), hard)
    assert found.certain
    assert found.mean == pytest.approx(0.1, abs=0.02)


def test_pairs_without_a_figure_are_left_out_and_equal_ones_have_no_width() -> None:
    found = paired(np.array([1.0, 2.0, np.nan]), np.array([0.5, 1.5, 1.0]))
    assert (found.mean, found.low, found.high, found.pairs) == (0.5, 0.5, 0.5, 2)
    assert paired(np.array([np.nan]), np.array([1.0])).pairs == 0
    with pytest.raises(ValueError, match="cannot be paired"):
        paired(np.zeros(2), np.zeros(3))


def test_an_interval_is_told_with_its_sign_and_four_places() -> None:
    assert str(interval(np.array([0.5, 0.5]))) == "+0.5000 [+0.5000, +0.5000]"
    assert str(interval(np.array([-0.01, -0.03]))).startswith("-0.0200 [-0.1471, +0.1071]")


def test_no_benchmark_has_a_bootstrap_of_its_own() -> None:
    own = [path for path in (ROOT / "bench").rglob("*.py") if "bootstrap(" in path.read_text(encoding="utf-8")]
    assert own == []

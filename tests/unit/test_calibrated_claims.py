"""How far a belief is to be trusted, learned in flight; and what is claimed of the map by that."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.optimize import minimize

from fleet.functions.belief import Belief
from fleet.functions.classes import classes
from fleet.planning.calibration import (
    PRECISION,
    PRIOR,
    REMEMBERED,
    Calibration,
    expected_accuracy,
    fit,
)
from fleet.planning.interest import FEW
from tests.planning import SMOOTH, Values, drawn, full, probabilities_of


def with_pairs(said: Sequence[float] | Values, right: Sequence[bool] | Values) -> Calibration:
    calibration = Calibration()
    calibration.pairs.extend((float(share), bool(hit)) for share, hit in zip(said, right, strict=True))
    return calibration


@pytest.mark.parametrize(("pairs", "slope"), [(1, 1.0), (10, 0.3), (60, 1.0), (400, 0.3), (400, 2.0)])
def test_the_fit_is_the_most_probable_one(pairs: int, slope: float) -> None:
    generator = np.random.default_rng(pairs)
    said = generator.uniform(0.0, 1.0, pairs)
    logit = np.log(np.clip(said, 0.02, 0.99) / (1.0 - np.clip(said, 0.02, 0.99)))
    right = (generator.random(pairs) < 1.0 / (1.0 + np.exp(-slope * logit))).astype(np.float64)

    def improbability(line: Values) -> float:
        """Minus the log posterior: right answers of a logistic model, and a normal prior."""
        log_odds = line[0] + line[1] * logit
        likelihood = (right * log_odds - np.logaddexp(0.0, log_odds)).sum()
        return float(-likelihood + 0.5 * (PRECISION * (line - PRIOR) ** 2).sum())

    found = minimize(improbability, PRIOR, method="BFGS", options={"gtol": 1e-7})
    np.testing.assert_allclose(fit(said, right), found.x, atol=1e-5)


def test_without_pairs_probabilities_stay_as_they_are_within_their_bounds() -> None:
    said = np.linspace(0.02, 0.99, 50)
    np.testing.assert_allclose(Calibration().calibrated(said), said, rtol=1e-12)
    np.testing.assert_allclose(Calibration().calibrated(np.array([0.0, 1.0])), [0.02, 0.99], rtol=1e-12)


def test_predictions_that_come_true_as_often_as_they_say_stay_as_they_are() -> None:
    said = np.repeat([0.6, 0.75, 0.9], 100)
    right = np.tile(np.arange(100), 3) < np.repeat([60, 75, 90], 100)
    np.testing.assert_allclose(with_pairs(said, right).calibrated(said), said, atol=0.001)


@pytest.mark.parametrize("slope", [0.5, 0.7, 1.0, 1.5])
def test_after_400_captures_claims_are_off_by_less_than_two_points(slope: float) -> None:
    """On the mean over many draws: that of one draw is off by luck."""
    generator = np.random.default_rng(3)
    said = generator.uniform(0.5, 0.98, REMEMBERED)
    chance = 1.0 / (1.0 + np.exp(-slope * np.log(said / (1.0 - said))))
    claims = [with_pairs(said, generator.random(REMEMBERED) < chance).calibrated(said).mean() for _ in range(60)]
    assert np.mean(claims) == pytest.approx(chance.mean(), abs=0.02)
    assert slope in (1.0, 1.5) or abs(said.mean() - chance.mean()) > 0.05


def test_few_captures_move_claims_only_a_little() -> None:
    unlucky = with_pairs([0.9] * 4, [False] * 4).calibrated(np.array([0.9]))
    assert 0.8 < float(unlucky[0]) < 0.9


def test_only_the_last_captures_count() -> None:
    calibration = with_pairs([0.9] * 2 * REMEMBERED, [False] * REMEMBERED + [True] * REMEMBERED)
    assert len(calibration.pairs) == REMEMBERED
    assert float(calibration.calibrated(np.array([0.9]))[0]) > 0.9


@pytest.mark.parametrize("seed", range(4))
def test_a_prediction_is_what_was_believed_when_the_belief_was_last_asked(seed: int) -> None:
    """Naively: the belief as it was at the first of each so many captures, made anew from what was known then."""
    lag, grid, truth = 5, full(8, 9), drawn(seed, 8, 9).reshape(-1)
    cells = np.random.default_rng(seed).permutation(grid.cells)[:50]
    belief, calibration = Belief(grid, SMOOTH), Calibration(lag=lag)
    for cell in cells:
        calibration.foresee(belief, int(cell), float(truth[cell]))
        belief.observe([cell], [truth[cell]])
    expected = []
    for order in range(FEW, len(cells)):
        asked = FEW + (order - FEW) // lag * lag
        before = Belief(grid, SMOOTH)
        before.observe(cells[:asked], truth[cells[:asked]])
        said = probabilities_of(before, int(cells[order]))
        found = classes(truth[cells[order], None], before.class_mean)[0]
        expected.append((pytest.approx(said.max(), abs=1e-9), bool(said.argmax() == found)))
    assert list(calibration.pairs) == expected
    assert calibration.count == len(cells) - FEW


def test_when_much_is_captured_the_belief_is_asked_less_often() -> None:
    """After 600 captures every third one, although the lag is one."""
    grid, truth = full(30, 30), np.random.default_rng(2).normal(100.0, 20.0, 900)
    cells = np.random.default_rng(3).permutation(900)
    belief, calibration, asked = Belief(grid, SMOOTH), Calibration(lag=1), []
    belief.observe(cells[:600], truth[cells[:600]])
    for order in range(600, 612):
        if order % 3 == 0:
            said = belief.class_probabilities().reshape(4, -1).max(axis=0)
        asked.append(said[cells[order]])
        calibration.foresee(belief, int(cells[order]), float(truth[cells[order]]))
        belief.observe([cells[order]], [truth[cells[order]]])
    assert [said for said, _ in calibration.pairs] == pytest.approx(asked, rel=1e-12)


@pytest.mark.parametrize("value", [-1e6, 0.0, 95.0, 1e6])
def test_what_is_captured_never_changes_what_was_foretold(value: float) -> None:
    grid, truth = full(8, 9), drawn(0, 8, 9).reshape(-1)
    belief, calibration = Belief(grid, SMOOTH), Calibration()
    belief.observe(np.arange(0, 60, 3), truth[0:60:3])
    probabilities = probabilities_of(belief, 31)
    calibration.foresee(belief, 31, value)
    ((said, right),) = calibration.pairs
    assert said == pytest.approx(probabilities.max(), abs=1e-9)
    assert right == bool(probabilities.argmax() == classes(np.array([value]), belief.class_mean)[0])
    assert belief.free.flat[31]


def test_nothing_is_foretold_of_little() -> None:
    belief, calibration = Belief(full(5, 5), SMOOTH), Calibration()
    belief.observe(np.arange(FEW - 1), np.arange(FEW - 1.0))
    calibration.foresee(belief, 20, 1.0)
    assert (calibration.count, len(calibration.pairs)) == (0, 0)
    assert expected_accuracy(belief, calibration) == 0.0


def test_claims_are_captured_cells_and_the_chance_of_each_other_one() -> None:
    truth, belief = drawn(5, 8, 9).reshape(-1), Belief(full(8, 9), SMOOTH)
    belief.observe(np.arange(0, 72, 4), truth[::4])
    calibration = with_pairs([0.9] * 100, [True] * 60 + [False] * 40)
    offset, slope = fit(np.full(100, 0.9), np.array([1.0] * 60 + [0.0] * 40))
    total = 18.0
    for cell in set(range(72)) - set(range(0, 72, 4)):
        share = min(max(float(probabilities_of(belief, cell).max()), 0.02), 0.99)
        total += 1.0 / (1.0 + np.exp(-offset - slope * np.log(share / (1.0 - share))))
    assert expected_accuracy(belief, calibration) == pytest.approx(total / 72, rel=1e-9)
    assert expected_accuracy(belief, calibration) < expected_accuracy(belief, Calibration())


@pytest.mark.parametrize("cells", [FEW - 4, 30])
def test_of_a_captured_field_all_is_known(cells: int) -> None:
    belief = Belief(full(2, cells // 2), SMOOTH)
    belief.observe(np.arange(cells), np.arange(cells) % 7)
    assert expected_accuracy(belief, Calibration()) == 1.0


@pytest.mark.parametrize(("captured", "points"), [(0.15, 2.5), (0.4, 1.5)])
def test_where_the_field_is_what_kriging_takes_it_for_claims_are_true(captured: float, points: float) -> None:
    """Fields drawn from the covariance that is believed in: claims need no calibration, on the mean over fields."""
    grid, errors = full(16, 18), []
    for seed in range(24):
        truth, belief = drawn(seed, 16, 18), Belief(grid, SMOOTH)
        cells = np.random.default_rng(seed).permutation(grid.cells)[: int(captured * grid.cells)]
        belief.observe(cells, truth.reshape(-1)[cells])
        wanted = classes(truth, belief.class_mean)
        found = np.where(belief.known, wanted, belief.class_probabilities().argmax(axis=0))
        errors.append(expected_accuracy(belief, Calibration()) - float((found == wanted).mean()))
    assert abs(np.mean(errors)) < points / 100.0
    assert np.std(errors) < 0.06

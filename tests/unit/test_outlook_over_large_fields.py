"""What an agent sees of a field that is too large to be looked at whole."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, uniform_filter

from fleet.contexts.grid import Grid
from fleet.functions.belief import Belief
from fleet.functions.kriging import Variogram
from fleet.planning.calibration import Calibration, expected_accuracy
from fleet.planning.interest import interest
from fleet.planning.outlook import WHOLE, Outlook
from fleet.planning.outlook_kernel import promising
from fleet.planning.tactics import InterestWeights
from tests.planning import CELL_M, Values

WEIGHTS = InterestWeights()


def smooth(seed: int, rows: int, columns: int) -> Values:
    noise = np.random.default_rng(seed).normal(size=(rows, columns))
    return 100.0 + 120.0 * gaussian_filter(noise, 4.0) + 2.0 * noise


def flown_over(seed: int, rows: int, columns: int, share: float) -> Belief:
    """Captured along rows, a few cells apart, in the first part of the field; and here and there in the rest."""
    truth, generator = smooth(seed, rows, columns), np.random.default_rng(seed)
    belief = Belief(Grid(np.ones((rows, columns), dtype=np.bool_), CELL_M, CELL_M), Variogram(60.0, 0.05, 220.0))
    captured = np.zeros((rows, columns), dtype=np.bool_)
    captured[: round(share * rows) : 3] = True
    captured |= generator.random((rows, columns)) < 0.02
    cells = np.flatnonzero(captured)
    belief.observe(cells, truth.flat[cells])
    return belief


def richness(belief: Belief, cell: int, claimed: Sequence[int] = ()) -> Values:
    wanted = interest(belief, WEIGHTS)
    wanted.flat[list(claimed)] = 0.0
    row, column = belief.grid.position(cell)
    rows, columns = np.ogrid[: belief.grid.rows, : belief.grid.columns]
    way = np.abs(rows - row) + np.abs(columns - column)
    return np.where((wanted > 0.0) & (way > 0), uniform_filter(wanted, 5, mode="constant") / (way + 6.0), 0.0)


@pytest.mark.parametrize("shape", [(100, 110), (300, 60), (2, 5000), (9000, 1)])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_the_typical_interest_is_about_that_of_the_whole_field(shape: tuple[int, int], share: float) -> None:
    belief = flown_over(1, *shape, share)
    wanted = interest(belief, WEIGHTS)
    positive = np.sort(wanted[wanted > 0.0])
    assert belief.grid.cells > WHOLE
    found = Outlook(belief, 16).view(0, WEIGHTS).typical
    assert found == pytest.approx(positive[len(positive) // 2 :].mean(), rel=0.15)


@pytest.mark.parametrize("horizon", [1, 7, 16])
def test_within_reach_an_agent_sees_what_there_is_while_cells_are_captured(horizon: int) -> None:
    belief, truth = flown_over(4, 90, 100, 0.3), smooth(4, 90, 100)
    outlook, generator = Outlook(belief, horizon), np.random.default_rng(horizon)
    for cell in [0, 99, 8_999, 8_900, *generator.integers(0, 9_000, 12).tolist()]:
        row, column = divmod(cell, 100)
        window = np.s_[max(row - horizon, 0) : row + horizon + 1, max(column - horizon, 0) : column + horizon + 1]
        seen = outlook.view(cell, WEIGHTS).interest
        np.testing.assert_allclose(seen, interest(belief, WEIGHTS)[window], rtol=1e-9, atol=1e-12)
        new = generator.integers(0, 9_000, 40)
        belief.observe(new, truth.flat[new])


def test_what_was_looked_at_before_does_not_matter() -> None:
    belief, generator = flown_over(7, 140, 150, 0.6), np.random.default_rng(7)
    used = Outlook(belief, 16)
    for cell in generator.integers(0, belief.grid.cells, 40).tolist():
        for other in generator.integers(0, belief.grid.cells, 3).tolist():
            used.view(other, InterestWeights(doubt=50.0))
            used.richest(other, InterestWeights(doubt=50.0))
        fresh = Outlook(belief, 16)
        assert used.richest(cell, WEIGHTS) == fresh.richest(cell, WEIGHTS)
        assert np.array_equal(used.view(cell, WEIGHTS).interest, fresh.view(cell, WEIGHTS).interest)


def test_each_tile_that_may_be_rich_is_listed_once() -> None:
    belief = flown_over(5, 150, 170, 0.5)
    outlook = Outlook(belief, 16)
    for start in [(0, 0), (149, 169), (80, 80), (130, 3)]:
        count = promising(belief.state, outlook._sketch, outlook._wishes(WEIGHTS), start)
        listed = outlook._sketch.listed[:count].tolist()
        assert 3 < len(listed) == len(set(listed)) <= 16
        assert (np.diff(outlook._sketch.score[:count]) <= 0.0).all()


def test_what_is_left_over_between_the_sampled_cells_of_a_tile_is_not_overlooked() -> None:
    """One cell is left in each of 49 tiles, all of them where no doubt is asked for."""
    left = np.zeros((112, 112), dtype=np.bool_)
    left[6::16, 9::16] = True
    belief = Belief(Grid(np.ones_like(left), CELL_M, CELL_M), Variogram(60.0, 0.05, 220.0))
    known = np.flatnonzero(~left)
    belief.observe(known, smooth(6, 112, 112).flat[known])
    outlook = Outlook(belief, 16)
    for cell in np.random.default_rng(1).integers(0, belief.grid.cells, 12).tolist():
        found, score = outlook.richest(cell, WEIGHTS), richness(belief, cell)
        assert found is not None
        assert score.flat[found] >= 0.85 * score.max()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("share", [0.3, 0.9])
def test_a_place_is_found_that_is_nearly_as_rich_as_the_richest(seed: int, share: float) -> None:
    belief = flown_over(seed, 120, 130, share)
    outlook = Outlook(belief, 16)
    for cell in np.random.default_rng(seed).integers(0, belief.grid.cells, 12).tolist():
        found, score = outlook.richest(cell, WEIGHTS), richness(belief, cell)
        assert found is not None
        assert score.flat[found] >= 0.85 * score.max()


def test_the_last_free_cell_is_found_wherever_it_is() -> None:
    for left in (0, 137, 11_999, 60 * 120 + 60):
        belief = Belief(Grid(np.ones((100, 120), dtype=np.bool_)), Variogram(6.0, 0.1, 50.0))
        cells = np.setdiff1d(np.arange(12_000), [left])
        belief.observe(cells, np.random.default_rng(0).normal(100.0, 7.0, len(cells)))
        outlook = Outlook(belief, 16)
        assert outlook.richest(5_000, WEIGHTS) == left
        outlook.claim(3, [left, left])
        assert outlook.richest(5_000, WEIGHTS) is None
        outlook.claim(3, ())
        assert outlook.richest(5_000, WEIGHTS) == left


def test_where_others_claim_all_that_is_near_what_is_far_is_found() -> None:
    belief = flown_over(2, 120, 130, 0.0)
    outlook, claimed = Outlook(belief, 16), np.arange(90 * 130)
    outlook.claim(0, claimed.tolist())
    found, score = outlook.richest(65, WEIGHTS), richness(belief, 65, claimed.tolist())
    assert found is not None
    assert score.flat[found] > 0.0


def test_a_field_without_doubt_is_flown_over_all_the_same() -> None:
    """Where all values are equal nothing is in doubt, and no place is richer than another but by its novelty."""
    belief = Belief(Grid(np.ones((100, 100), dtype=np.bool_)))
    belief.observe(np.arange(50), np.full(50, 3.0))
    outlook = Outlook(belief, 16)
    assert outlook.richest(0, WEIGHTS) is not None
    assert outlook.richest(0, InterestWeights(novelty=0.0)) is None


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_claims_on_a_large_field_are_those_of_all_its_cells_to_a_third_of_a_point(share: float) -> None:
    belief = flown_over(3, 130, 140, share)
    probable = belief.class_probabilities().max(axis=0)[belief.free]
    exactly = (belief.captured + Calibration().calibrated(probable).sum()) / belief.cells
    assert len(belief.sample) < belief.cells
    assert expected_accuracy(belief, Calibration()) == pytest.approx(exactly, abs=0.0033)


def test_the_sample_of_a_field_is_evenly_spread_over_the_cells_with_data() -> None:
    valid = np.random.default_rng(0).random((150, 140)) < 0.8
    sample = Belief(Grid(valid)).sample
    assert len(sample) == len(set(sample.tolist())) == 4096
    assert valid.flat[sample].all()
    counts = np.histogram2d(*np.divmod(sample, 140), bins=[5, 5], range=[[0, 150], [0, 140]])[0]
    assert counts.min() > 100
    assert Belief(Grid(valid[:60, :60])).sample.tolist() == np.flatnonzero(valid[:60, :60]).tolist()
    assert np.array_equal(sample, Belief(Grid(valid)).sample)

"""What a capture is worth by what is believed."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.contexts.grid import Grid
from fleet.functions.belief import Belief
from fleet.planning.interest import FEW, doubts, interest
from fleet.planning.tactics import InterestWeights
from tests.planning import SMOOTH, Values, drawn, probabilities_of

DOUBT = InterestWeights(doubt=1.0, doubt_around=0.0, novelty=0.0)
AROUND = InterestWeights(doubt=0.0, doubt_around=1.0, novelty=0.0)
NOVELTY = InterestWeights(doubt=0.0, doubt_around=0.0, novelty=1.0)
ROWS, COLUMNS = 12, 14


def belief_of(captured: int, seed: int = 1) -> Belief:
    """A field with two rows and a corner without data, of which some cells are captured."""
    valid = np.ones((ROWS, COLUMNS), dtype=np.bool_)
    valid[0] = valid[-1] = valid[1:3, 1:3] = False
    belief, truth = Belief(Grid(valid, 10.0, 10.0), SMOOTH), drawn(seed, ROWS, COLUMNS).reshape(-1)
    cells = np.random.default_rng(seed).permutation(np.flatnonzero(valid))[:captured]
    belief.observe(cells, truth[cells])
    return belief


def wrong(belief: Belief, cell: int) -> float:
    """1 - the probability of the most probable class, cell by cell."""
    return 0.0 if belief.known.flat[cell] else 1.0 - float(probabilities_of(belief, cell).max())


@pytest.mark.parametrize("captured", [0, 1, FEW - 1, FEW, 60])
@pytest.mark.parametrize("weights", [InterestWeights(), DOUBT, AROUND, NOVELTY])
def test_only_cells_that_can_be_captured_are_interesting(captured: int, weights: InterestWeights) -> None:
    belief = belief_of(captured)
    found = interest(belief, weights)
    assert np.isfinite(found).all()
    assert (found[~belief.free] == 0.0).all()
    assert (found >= 0.0).all()
    assert found[belief.free].max() > 0.0


def test_at_first_every_cell_is_equally_interesting() -> None:
    belief = belief_of(FEW - 1)
    assert set(interest(belief, InterestWeights())[belief.free]) == {0.5}
    later = belief_of(FEW)
    assert len(set(interest(later, InterestWeights())[later.free])) > 10


def test_a_field_that_is_captured_is_of_no_interest() -> None:
    belief = belief_of(ROWS * COLUMNS)
    assert not belief.free.any()
    assert not interest(belief, InterestWeights()).any()


def test_doubt_is_the_probability_that_the_believed_class_is_wrong() -> None:
    belief = belief_of(40)
    valid = (belief.free | belief.known).reshape(-1)
    slow = [wrong(belief, cell) if valid[cell] else 0.0 for cell in range(ROWS * COLUMNS)]
    np.testing.assert_allclose(doubts(belief).reshape(-1), slow, atol=1e-12)
    np.testing.assert_array_equal(interest(belief, DOUBT), doubts(belief))
    assert 0.1 < max(slow) <= 0.75


def test_novelty_grows_with_the_distance_to_the_nearest_captured_cell() -> None:
    belief = belief_of(20)
    known = np.argwhere(belief.known)
    found = interest(belief, NOVELTY)
    for row, column in np.argwhere(belief.free):
        distance = np.hypot(known[:, 0] - row, known[:, 1] - column).min()
        assert found[row, column] == pytest.approx(1.0 - np.exp(-distance / 3.0), rel=1e-12)


def naively_around(doubt: Values, row: int, column: int) -> float:
    """Mean doubt of the cells up to 3 rows and columns away, nearer ones weighing more; 0 beyond the edge."""
    total, weights = 0.0, 0.0
    for down in range(-3, 4):
        for right in range(-3, 4):
            if down or right:
                weight = float(np.exp(-np.hypot(down, right) / 1.5))
                weights += weight
                if 0 <= row + down < ROWS and 0 <= column + right < COLUMNS:
                    total += weight * doubt[row + down, column + right]
    return total / weights


def test_doubt_around_is_a_mean_over_the_cells_around() -> None:
    belief = belief_of(40)
    found, doubt = interest(belief, AROUND), doubts(belief)
    for row, column in np.argwhere(belief.free):
        assert found[row, column] == pytest.approx(naively_around(doubt, row, column), abs=1e-12)


def test_shares_of_the_cells_around_add_up_to_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where all cells are equally doubtful, so is what is around a cell far from the edge."""
    belief = belief_of(40)
    monkeypatch.setattr("fleet.planning.interest.doubts", lambda belief: np.full((ROWS, COLUMNS), 0.4))
    found = interest(belief, AROUND)
    inner = np.zeros_like(belief.free)
    inner[3:-3, 3:-3] = belief.free[3:-3, 3:-3]
    np.testing.assert_allclose(found[inner], 0.4, rtol=1e-12)
    edge = np.zeros_like(inner)
    edge[1, :] = belief.free[1, :]
    assert found[edge].max() < 0.4


def test_features_are_added_by_their_weights() -> None:
    belief = belief_of(30)
    weights = InterestWeights(doubt=0.7, doubt_around=1.3, novelty=0.2)
    parts = 0.7 * interest(belief, DOUBT) + 1.3 * interest(belief, AROUND) + 0.2 * interest(belief, NOVELTY)
    np.testing.assert_allclose(interest(belief, weights), parts, rtol=1e-12)


def test_where_cells_are_not_square_novelty_goes_by_metres() -> None:
    """d / 3 with d in cells of the mean size: four times as high as wide, a row is 2 of them and a column a half."""
    belief = Belief(Grid(np.ones((9, 30), dtype=np.bool_), 20.0, 5.0), SMOOTH)
    belief.observe(np.arange(FEW), drawn(0, 9, 30).reshape(-1)[:FEW])
    found = interest(belief, NOVELTY)
    assert found[4, 3] == pytest.approx(1.0 - np.exp(-4 * 2.0 / 3.0), rel=1e-12)
    assert found[0, FEW + 5] == pytest.approx(1.0 - np.exp(-6 * 0.5 / 3.0), rel=1e-12)

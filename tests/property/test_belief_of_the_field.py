"""A belief that follows every captured cell against kriging from scratch."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from fleet.compiled import program
from fleet.contexts.base import Environment
from fleet.contexts.grid import Grid
from fleet.functions.belief import Belief, blank
from fleet.functions.classes import class_mean, class_probabilities
from fleet.functions.kriging import Prediction, Variogram, krige, predict
from fleet.functions.kriging_kernel import TILE, below, settle, take_in

Values = NDArray[np.float64]
SOME = Variogram(12.0, 0.2, 30.0)


@st.composite
def flights(draw: st.DrawFn) -> tuple[Grid, Values, list[NDArray[np.int64]]]:
    """A field with holes, its values, and the cells that are captured one batch after the other."""
    shape = draw(hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=20))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    valid = generator.random(shape) < draw(st.sampled_from([0.3, 0.9, 1.0]))
    valid[0, 0] = True
    height, width = draw(st.sampled_from([(1.0, 1.0), (11.9, 8.9), (7.0, 1.0)]))
    cells = generator.permutation(valid.size) if draw(st.booleans()) else np.arange(valid.size)
    batches = draw(st.lists(st.sampled_from([1, 1, 2, 3, 5, 10, 70, 150]), min_size=1, max_size=12))
    ends = np.cumsum(batches)
    values = generator.normal(100.0, 5.0, size=shape)
    return Grid(valid, height, width), values, np.split(cells[: ends[-1]], ends[:-1])


def from_scratch(grid: Grid, values: Values, known: NDArray[np.bool_], variogram: Variogram) -> Prediction:
    wanted = grid.valid & ~known
    expected, deviation = np.where(known, values, np.nan), np.where(grid.valid, 0.0, np.nan)
    if known.any() and wanted.any():
        expected[wanted], deviation[wanted] = predict(values, known, wanted, grid, variogram)
    return Prediction(expected, deviation)


@settings(max_examples=80)
@given(flights(), st.sampled_from([SOME, None]))
def test_after_every_capture_a_belief_is_kriging_from_scratch(
    flight: tuple[Grid, Values, list[NDArray[np.int64]]], variogram: Variogram | None
) -> None:
    grid, values, batches = flight
    belief, known = Belief(grid, variogram), np.zeros(grid.valid.shape, dtype=bool)
    for cells in batches:
        belief.observe(cells, values.reshape(-1)[cells])
        known.reshape(-1)[cells] = True
        known &= grid.valid
        wanted, found = from_scratch(grid, values, known, belief.variogram), belief.prediction()
        np.testing.assert_array_equal(found.values, wanted.values)
        np.testing.assert_array_equal(found.deviation, wanted.deviation)
        assert belief.captured == np.count_nonzero(known)


@settings(max_examples=40)
@given(flights())
def test_probabilities_of_classes_are_those_of_the_map(flight: tuple[Grid, Values, list[NDArray[np.int64]]]) -> None:
    grid, values, batches = flight
    belief = Belief(grid)
    for cells in batches:
        belief.observe(cells, values.reshape(-1)[cells])
    map_ = belief.prediction()
    mean = class_mean(map_.values, Environment("field", "", grid))
    assert belief.class_mean == pytest.approx(mean, rel=1e-12)
    np.testing.assert_allclose(belief.class_probabilities(mean), class_probabilities(map_, mean), atol=1e-12)
    np.testing.assert_allclose(belief.class_probabilities(103.0), class_probabilities(map_, 103.0), atol=1e-12)


@settings(max_examples=40)
@given(flights())
def test_free_cells_are_counted_tile_by_tile(flight: tuple[Grid, Values, list[NDArray[np.int64]]]) -> None:
    grid, values, batches = flight
    belief, free = Belief(grid, SOME), grid.valid.copy()
    for cells in batches:
        belief.observe(cells, values.reshape(-1)[cells])
        free.reshape(-1)[cells] = False
        np.testing.assert_array_equal(belief.free, free)
        for (row, column), left in np.ndenumerate(belief.state.left):
            assert left == np.count_nonzero(free[row * TILE : (row + 1) * TILE, column * TILE : (column + 1) * TILE])


def test_only_cells_whose_neighbours_change_are_predicted_anew() -> None:
    grid, generator = Grid(np.ones((60, 50), dtype=bool)), np.random.default_rng(1)
    belief, cells = Belief(grid, SOME), generator.permutation(3000)[:601]
    assert belief.observe(cells[:4], np.ones(4)) == 3000 - 4 + 3  # those that were captured in between are told too
    belief.observe(cells[4:600], generator.normal(size=596))
    before = belief.prediction()
    changed = belief.observe(cells[600:], [7.0])
    assert 0 < changed < 60
    assert 0 < np.count_nonzero(belief.prediction().values != before.values) <= changed + 1


def test_a_belief_is_fitted_anew_when_it_has_grown_by_a_quarter() -> None:
    grid, generator = Grid(np.ones((30, 30), dtype=bool)), np.random.default_rng(2)
    values, cells = generator.normal(size=900).cumsum(), generator.permutation(900)
    belief = Belief(grid)
    belief.observe(cells[:100], values[cells[:100]])
    first = belief.variogram
    belief.observe(cells[100:124], values[cells[100:124]])
    assert belief.variogram == first
    belief.observe(cells[124:125], values[cells[124:125]])
    assert belief.variogram != first
    known = np.isin(np.arange(900), cells[:125]).reshape(30, 30)
    wanted, found = krige(np.where(known, values.reshape(30, 30), np.nan), grid), belief.prediction()
    np.testing.assert_array_equal(found.values, wanted.values)
    np.testing.assert_array_equal(found.deviation, wanted.deviation)


def test_cells_that_are_equally_near_are_so_to_a_belief_too() -> None:
    """Cells of 33 by 41 m: 41 rows are as far as 33 columns, and (33 / 41) ** 2 is not 33 / 41 * (33 / 41)."""
    grid, cells = Grid(np.ones((60, 45), dtype=bool), 33.0, 41.0), [125, 1937, *range(2690, 2697)]
    values = np.random.default_rng(0).normal(size=grid.cells).reshape(grid.valid.shape)
    for taken in (cells, cells[::-1]):
        belief, known = Belief(grid, SOME), np.zeros(grid.valid.shape, dtype=bool)
        for cell in taken:
            belief.observe([cell], [values.flat[cell]])
            known.flat[cell] = True
        wanted = from_scratch(grid, values, known, SOME)
        np.testing.assert_array_equal(belief.prediction().values, wanted.values)


def test_equal_values_are_believed_everywhere_until_another_one_is_found() -> None:
    belief = Belief(Grid(np.ones((5, 5), dtype=bool)))
    assert np.isnan(belief.prediction().values).all()
    assert belief.class_mean == 0.0
    belief.observe([0, 7, 9], [4.0, 4.0, 4.0])
    np.testing.assert_array_equal(belief.prediction().values, np.full((5, 5), 4.0))
    np.testing.assert_array_equal(belief.prediction().deviation, np.zeros((5, 5)))
    belief.observe([24], [6.0])
    assert belief.prediction().values.flat[23] > 4.0
    assert belief.prediction().deviation.flat[23] > 0.0


def test_more_of_the_same_is_no_reason_to_predict_the_whole_field_anew() -> None:
    grid, cells = Grid(np.ones((60, 50), dtype=bool)), np.random.default_rng(1).permutation(3000)[:402]
    belief = Belief(grid)
    belief.observe(cells[:400], np.full(400, 4.0))
    assert 0 < belief.observe(cells[400:401], [4.0]) < 300
    assert belief.variogram.variance == 0.0
    assert belief.observe(cells[401:], [5.0]) == 3000 - 402
    assert belief.variogram.variance > 0.0


def test_what_says_nothing_new_changes_nothing() -> None:
    valid = np.ones((4, 4), dtype=bool)
    valid[0, 0] = False
    belief = Belief(Grid(valid), SOME)
    belief.observe([3, 12], [1.0, 2.0])
    before = belief.prediction()
    assert belief.observe([3, 0, 5], [9.0, 9.0, np.nan]) == 0
    assert belief.observe([], []) == 0
    np.testing.assert_array_equal(belief.prediction().values, before.values)
    assert belief.captured == 2


@pytest.mark.parametrize(("cells", "values"), [([16], [1.0]), ([-1], [1.0]), ([1, 2], [1.0])])
def test_cells_beside_the_grid_and_values_that_lack_are_errors(cells: list[int], values: list[float]) -> None:
    with pytest.raises(ValueError, match=r"not on the grid|one value for each cell"):
        Belief(Grid(np.ones((4, 4), dtype=bool))).observe(cells, values)


@program
def scout(belief: Any, truth: Any, steps: Any, bound: Any) -> Any:
    """A flight that goes on where the class is least clear."""
    cell = 0
    for _ in range(steps):
        changed = take_in(belief, cell, truth[cell], 0)
        settle(belief, changed)
        closest = 1.0
        for other in range(len(truth)):
            if belief.reach[other] >= 0.0:
                apart = abs(below(bound, belief.mean[other], belief.deviation[other]) - 0.5)
                if apart < closest:
                    closest, cell = apart, other
    return cell


def test_a_compiled_flight_has_the_same_belief() -> None:
    grid, truth = Grid(np.ones((20, 30), dtype=bool), 3.0, 2.0), np.random.default_rng(3).normal(size=600)
    state, belief = blank(grid, SOME), Belief(grid, SOME)
    last = scout(state, truth, 40, 0.5)
    assert state.captured[0] == 40
    assert state.reach[last] >= 0.0
    flown = np.flatnonzero(state.reach < 0.0)
    belief.observe(flown, truth[flown])
    np.testing.assert_array_equal(state.mean, belief.state.mean)
    np.testing.assert_array_equal(state.deviation, belief.state.deviation)
    left = state.reach >= 0.0
    np.testing.assert_array_equal(state.near[left], belief.state.near[left])

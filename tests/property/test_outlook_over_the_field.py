"""What an agent sees of a part of the field against the interest of the whole field."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import uniform_filter

from fleet.contexts.grid import Grid
from fleet.functions.belief import Belief
from fleet.functions.kriging import Variogram
from fleet.planning.interest import FEW, interest
from fleet.planning.outlook import Outlook
from fleet.planning.tactics import InterestWeights
from tests.planning import Values

weight = st.sampled_from([0.0, 0.3, 1.0, 2.5])


@dataclass(frozen=True, eq=False)
class Case:
    """What is believed, where an agent is, what it wants, and what others claim, by their number."""

    belief: Belief
    cell: int
    weights: InterestWeights
    claims: list[list[int]]

    @property
    def wanted(self) -> Values:
        """Naively: the interest of the whole field, without what others claim."""
        found = interest(self.belief, self.weights)
        for cells in self.claims:
            found.flat[cells] = 0.0
        return found

    def outlook(self, horizon: int) -> Outlook:
        outlook = Outlook(self.belief, horizon)
        for agent, cells in enumerate(self.claims):
            outlook.claim(agent, cells)
        return outlook

    def richness(self) -> Values:
        """Naively: mean interest over 5 x 5 cells for the way there; 0 where the agent is and without interest."""
        grid, wanted = self.belief.grid, self.wanted
        row, column = grid.position(self.cell)
        rows, columns = np.ogrid[: grid.rows, : grid.columns]
        way = np.abs(rows - row) + np.abs(columns - column)
        return np.where((wanted > 0.0) & (way > 0), uniform_filter(wanted, 5, mode="constant") / (way + 6.0), 0.0)


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Fields with holes, more or less of which is captured."""
    rows, columns = draw(st.integers(1, 40)), draw(st.integers(1, 40))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    valid = generator.random((rows, columns)) < draw(st.sampled_from([0.5, 0.9, 1.0]))
    valid[0, 0] = True
    height, width = draw(st.sampled_from([(1.0, 1.0), (11.9, 8.9), (3.0, 10.0)]))
    variogram = Variogram(4.0 * width, 0.1, 200.0) if draw(st.booleans()) else None
    belief, cells = Belief(Grid(valid, height, width), variogram), generator.permutation(np.flatnonzero(valid))
    captured = cells[: draw(st.one_of(st.integers(0, FEW + 1), st.integers(0, len(cells))))]
    belief.observe(captured, generator.normal(100.0, 15.0, len(captured)))
    claims = [
        generator.integers(0, valid.size, draw(st.integers(0, 12))).tolist() for _ in range(draw(st.integers(0, 3)))
    ]
    weights = InterestWeights(doubt=draw(weight), doubt_around=draw(weight), novelty=draw(weight))
    return Case(belief, draw(st.integers(0, valid.size - 1)), weights, claims)


@settings(max_examples=150)
@given(cases(), st.integers(1, 20))
def test_within_reach_an_agent_sees_what_there_is(case: Case, horizon: int) -> None:
    view, grid = case.outlook(horizon).view(case.cell, case.weights), case.belief.grid
    row, column = grid.position(case.cell)
    top, left = max(row - horizon, 0), max(column - horizon, 0)
    expected = case.wanted[top : row + horizon + 1, left : column + horizon + 1]
    np.testing.assert_allclose(view.interest, expected, rtol=1e-9, atol=1e-12)
    assert np.array_equal(view.interest > 0.0, expected > 0.0)
    assert divmod(view.cell, view.interest.shape[1]) == (row - top, column - left)


@settings(max_examples=100)
@given(cases())
def test_on_a_small_field_the_typical_interest_is_the_mean_of_the_better_half(case: Case) -> None:
    positive = np.sort(case.wanted[case.wanted > 0.0])
    expected = positive[len(positive) // 2 :].mean() if len(positive) else 0.0
    assert case.outlook(5).view(case.cell, case.weights).typical == pytest.approx(expected, rel=1e-9)


@settings(max_examples=100)
@given(cases())
def test_on_a_small_field_the_richest_place_for_the_way_there_is_found(case: Case) -> None:
    found, richness = case.outlook(5).richest(case.cell, case.weights), case.richness()
    if found is None:
        assert not richness.any()
    else:
        assert richness.flat[found] == pytest.approx(richness.max(), rel=1e-9)
        assert richness.max() > 0.0


@settings(max_examples=60)
@given(cases(), st.data())
def test_what_was_looked_at_before_does_not_matter(case: Case, data: st.DataObject) -> None:
    used, fresh = case.outlook(6), case.outlook(6)
    for _ in range(3):
        before = data.draw(st.integers(0, case.belief.grid.cells - 1))
        used.claim(9, [before, before, case.cell])
        used.view(before, InterestWeights(doubt=0.1))
        used.richest(before, InterestWeights(novelty=3.0))
    used.claim(9, ())
    assert used.richest(case.cell, case.weights) == fresh.richest(case.cell, case.weights)
    one, other = used.view(case.cell, case.weights), fresh.view(case.cell, case.weights)
    assert np.array_equal(one.interest, other.interest)
    assert one.typical == other.typical


@settings(max_examples=60)
@given(cases(), st.data())
def test_what_is_captured_later_is_seen_too(case: Case, data: st.DataObject) -> None:
    outlook, free = case.outlook(40), np.flatnonzero(case.belief.free)
    outlook.view(case.cell, case.weights)
    if len(free):
        case.belief.observe([data.draw(st.sampled_from(free.tolist()))], [130.0])
    seen = outlook.view(0, case.weights)
    np.testing.assert_allclose(seen.interest, case.wanted[:41, :41], rtol=1e-9, atol=1e-12)

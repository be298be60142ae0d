"""Groups and parts cover a field once, whatever its shape."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fleet.contexts.grid import Grid
from fleet.missions.layout import divide, form_groups
from fleet.spec.swarm import GroupOrder


@st.composite
def grids(draw: st.DrawFn) -> Grid:
    rows, columns = draw(st.integers(1, 14)), draw(st.integers(1, 14))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return Grid(generator.random((rows, columns)) < draw(st.sampled_from([0.1, 0.6, 1.0])))


@settings(max_examples=100)
@given(grids(), st.integers(1, 6), st.integers(1, 6), st.sampled_from(GroupOrder))
def test_every_cell_with_data_is_in_one_group_of_neighbours(
    grid: Grid, rows: int, columns: int, order: GroupOrder
) -> None:
    groups = form_groups(grid, rows, columns, order)
    cells = np.concatenate([*groups, np.array([], dtype=np.int64)])
    assert sorted(cells.tolist()) == np.flatnonzero(grid.valid).tolist()
    for group in groups:
        assert len(group) > 0
        assert (np.diff(group) > 0).all()
        blocks = {(cell // grid.columns // rows, cell % grid.columns // columns) for cell in group.tolist()}
        assert len(blocks) == 1


@settings(max_examples=100)
@given(grids(), st.integers(1, 6), st.integers(1, 6))
def test_orders_hold_the_same_groups(grid: Grid, rows: int, columns: int) -> None:
    assume(grid.valid.any())
    first, *others = (
        sorted(group.tolist() for group in form_groups(grid, rows, columns, order)) for order in GroupOrder
    )
    assert all(other == first for other in others)


@settings(max_examples=200)
@given(st.lists(st.integers(1, 9), min_size=1, max_size=40), st.integers(1, 8))
def test_parts_are_consecutive_and_nobody_goes_empty(sizes: list[int], agents: int) -> None:
    assume(len(sizes) >= agents)
    parts = divide(sizes, agents)
    assert [first for first, _ in parts] == [0, *(end for _, end in parts[:-1])]
    assert parts[-1][1] == len(sizes)
    assert all(first < end for first, end in parts)


@settings(max_examples=200)
@given(st.lists(st.integers(1, 9), min_size=40, max_size=80), st.integers(1, 4))
def test_parts_are_nearly_equal_when_groups_are_small(sizes: list[int], agents: int) -> None:
    ends = np.cumsum([0, *sizes])
    for first, end in divide(sizes, agents):
        assert abs(ends[end] - ends[first] - ends[-1] / agents) <= max(sizes)


def test_serpentine_groups_are_neighbours_of_the_groups_before() -> None:
    for order in (GroupOrder.SERPENTINE, GroupOrder.COLUMN_SERPENTINE, GroupOrder.NEAREST):
        groups = form_groups(Grid(np.ones((9, 12), dtype=np.bool_)), 3, 3, order)
        places = [(group[0] // 12 // 3, group[0] % 12 // 3) for group in groups]
        assert all(abs(a[0] - b[0]) + abs(a[1] - b[1]) == 1 for a, b in pairwise(places))

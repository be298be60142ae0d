"""Each agent's part of the field."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from fleet.contexts.grid import Grid
from fleet.errors import MissionError
from fleet.missions.partition import parts, pieces

grids = st.builds(Grid, hnp.arrays(np.bool_, hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=12)))


def naive_pieces(grid: Grid, cells: NDArray[np.int64]) -> int:
    """Cells are taken out piece by piece, neighbour by neighbour."""
    left, found = {grid.position(int(cell)) for cell in cells}, 0
    while left:
        found += 1
        reached = [left.pop()]
        while reached:
            row, column = reached.pop()
            near = {(row + down, column + right) for down in (-1, 0, 1) for right in (-1, 0, 1)} & left
            left -= near
            reached += near
    return found


@given(grids, st.integers(1, 20))
def test_every_cell_with_data_is_in_one_part_and_parts_are_equally_large(grid: Grid, agents: int) -> None:
    cells = np.flatnonzero(grid.valid)
    if len(cells) < agents:
        with pytest.raises(MissionError, match=f"{agents} agents but only {len(cells)} cells with data"):
            parts(grid, agents)
        return
    found = parts(grid, agents)
    assert len(found) == agents
    assert np.sort(np.concatenate(found)).tolist() == cells.tolist()
    assert all((np.diff(part) > 0).all() for part in found)
    sizes = [len(part) for part in found]
    assert max(sizes) - min(sizes) <= 1
    assert min(sizes) >= 1


@given(grids)
def test_pieces_hang_together_at_sides_and_corners(grid: Grid) -> None:
    cells = np.flatnonzero(grid.valid)
    assert pieces(grid, cells) == naive_pieces(grid, cells)


@given(st.integers(1, 14), st.integers(1, 14), st.integers(1, 14))
def test_parts_of_a_full_field_are_in_one_piece(rows: int, columns: int, agents: int) -> None:
    grid = Grid(np.ones((rows, columns), dtype=np.bool_))
    if agents <= grid.cells:
        assert [naive_pieces(grid, part) for part in parts(grid, agents)] == [1] * agents


@given(grids, st.integers(0, 9))
def test_two_halves_are_in_as_few_pieces_as_one_straight_cut_can_leave(grid: Grid, more_rows: int) -> None:
    field = Grid(np.pad(grid.valid, ((0, more_rows), (0, 0)), constant_values=True))
    by_row = np.flatnonzero(field.valid)
    if len(by_row) < 2:
        return
    by_column = np.array(sorted(by_row, key=lambda cell: field.position(int(cell))[::-1]))
    halves = parts(field, 2)
    first = len(halves[0])
    cuts = [(order[:first], order[first:]) for order in (by_row, by_column)]
    assert sum(naive_pieces(field, half) for half in halves) == min(
        sum(naive_pieces(field, half) for half in cut) for cut in cuts
    )

"""Beam search for a path against trying every path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fleet.contexts.grid import Grid
from fleet.missions.layout import MOVES
from fleet.planning.paths import STRAIGHT, PathFinder
from fleet.planning.tactics import Search
from fleet.spec.swarm import Action
from tests.planning import ENERGY

EVERY = 400
"""More than there are paths of 5 moves, each of which may not undo the one before: 4 * 3^4."""
REVERSE = {
    Action.NORTH: Action.SOUTH,
    Action.SOUTH: Action.NORTH,
    Action.EAST: Action.WEST,
    Action.WEST: Action.EAST,
}
around = st.sampled_from([(True, True), (True, False), (False, True), (False, False)])


@dataclass(frozen=True, eq=False)
class Case:
    """What a path is looked for in: cells of interest, where it begins, the move before, and what a joule is worth."""

    grid: Grid
    interest: NDArray[np.float64]
    cell: int
    last: int
    rate: float

    def best(self, horizon: int, width: int) -> tuple[int, ...]:
        finder = PathFinder(self.grid, ENERGY, Search(horizon=horizon, width=width))
        return finder.best(self.interest, self.cell, self.last, self.rate)


@st.composite
def cases(draw: st.DrawFn, ties: bool) -> Case:
    """Captured cells among others; with ties many ways are worth the same."""
    rows, columns = draw(st.integers(1, 6)), draw(st.integers(1, 6))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    values = generator.integers(1, 3, (rows, columns)) / 2.0 if ties else generator.uniform(0.05, 1.0, (rows, columns))
    interest = np.where(generator.random((rows, columns)) < draw(st.sampled_from([0.0, 0.3, 0.8])), 0.0, values)
    cell = draw(st.integers(0, rows * columns - 1))
    interest.flat[cell] = 0.0  # an agent has captured the cell in which it is
    grid = Grid(np.ones((rows, columns), dtype=np.bool_), 3.0, 2.0, *draw(around))
    rate = draw(st.sampled_from([0.0, 2e-5, 3e-4, 8e-4]))
    return Case(grid, interest, cell, draw(st.integers(-1, STRAIGHT - 1)), rate)


def worth(case: Case, moves: tuple[int, ...]) -> float:
    """What a path brings, move by move; fails where it leaves the grid or undoes the move before."""
    cell, before, seen, total = case.cell, case.last, set(), 0.0
    for move in moves:
        assert before < 0 or MOVES[move] is not REVERSE[MOVES[before]]
        reached = case.grid.neighbour(cell, MOVES[move])
        assert reached is not None
        total -= case.rate * ENERGY.move(MOVES[move]).energy_j
        if case.interest.flat[reached] > 0.0 and reached not in seen:
            total += case.interest.flat[reached] - case.rate * ENERGY.capture().energy_j
        seen.add(reached)
        cell, before = reached, move
    return total


def every_path(case: Case, horizon: int) -> list[tuple[int, ...]]:
    """Each legal path of at most so many moves."""
    found: list[tuple[int, ...]] = []
    growing = [((), case.cell, case.last)]
    for _ in range(horizon):
        longer: list[tuple[tuple[int, ...], int, int]] = []
        for path, cell, before in growing:
            for move in range(STRAIGHT):
                reached = case.grid.neighbour(cell, MOVES[move])
                if reached is not None and (before < 0 or MOVES[move] is not REVERSE[MOVES[before]]):
                    longer.append(((*path, move), reached, move))
        found += [path for path, _, _ in longer]
        growing = longer
    return found


def most(case: Case, horizon: int) -> float:
    return max([0.0, *(worth(case, path) for path in every_path(case, horizon))])


@settings(max_examples=150)
@given(st.booleans().flatmap(cases), st.integers(1, 5))
def test_a_beam_with_room_for_every_path_finds_the_best_one(case: Case, horizon: int) -> None:
    found = case.best(horizon, EVERY)
    assert len(found) <= horizon
    assert worth(case, found) == pytest.approx(most(case, horizon), abs=1e-9)


def test_a_way_that_may_go_on_is_kept_beside_one_that_may_not() -> None:
    """Of two equal ways round the corner only the one over the south may then go on to the east and the north."""
    interest = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]])
    case = Case(Grid(np.ones((2, 3), dtype=np.bool_)), interest, 0, -1, 2e-5)
    found = case.best(4, EVERY)
    assert [MOVES[move] for move in found] == [Action.SOUTH, Action.EAST, Action.EAST, Action.NORTH]
    assert worth(case, found) == pytest.approx(most(case, 4), abs=1e-12)


@settings(max_examples=100)
@given(cases(ties=True), st.integers(1, 5), st.sampled_from([1, 3, 20, EVERY]))
def test_no_beam_finds_more_than_there_is(case: Case, horizon: int, width: int) -> None:
    found = worth(case, case.best(horizon, width))
    assert 0.0 <= found <= most(case, horizon) + 1e-9


@settings(max_examples=60)
@given(cases(ties=True), st.integers(1, 30), st.sampled_from([1, 8, 48]))
def test_paths_stay_on_the_grid_and_turn_nowhere_at_once_and_end_in_what_they_are_for(
    case: Case, horizon: int, width: int
) -> None:
    moves = case.best(horizon, width)
    assert not moves or worth(case, moves) > max(0.0, worth(case, moves[:-1]))


@given(cases(ties=True))
def test_there_is_no_path_when_nothing_is_worth_its_energy(case: Case) -> None:
    dear = Case(case.grid, case.interest, case.cell, case.last, 1.0)
    nothing = Case(case.grid, np.zeros_like(case.interest), case.cell, case.last, case.rate)
    assert dear.best(6, 48) == nothing.best(6, 48) == ()


@given(cases(ties=False), st.integers(1, 4))
def test_what_a_path_finder_found_before_does_not_matter(case: Case, horizon: int) -> None:
    finder = PathFinder(case.grid, ENERGY, Search(horizon=horizon, width=20))
    first = finder.best(case.interest, case.cell, case.last, case.rate)
    finder.best(case.interest.max() - case.interest, 0, -1, 0.0)
    assert finder.best(case.interest, case.cell, case.last, case.rate) == first == case.best(horizon, 20)


@given(st.integers(1, 9), st.integers(1, 9), around, st.data())
def test_the_way_to_a_cell_has_as_few_moves_as_there_can_be(
    rows: int, columns: int, go: tuple[bool, bool], data: st.DataObject
) -> None:
    grid = Grid(np.ones((rows, columns), dtype=np.bool_), 1.0, 1.0, *go)
    cell, target = (data.draw(st.integers(0, grid.cells - 1)) for _ in range(2))
    moves, at = PathFinder(grid, ENERGY, Search()).towards(cell, target), cell
    for move in moves:
        reached = grid.neighbour(at, MOVES[move])
        assert reached is not None
        at = reached
    (row, column), (last_row, last_column) = grid.position(cell), grid.position(target)
    assert at == target
    assert len(moves) == abs(last_row - row) + abs(last_column - column)


def test_the_way_to_a_cell_is_along_the_longer_side_that_is_left() -> None:
    grid = Grid(np.ones((9, 9), dtype=np.bool_))
    names = [MOVES[move] for move in PathFinder(grid, ENERGY, Search()).towards(0, grid.cell(1, 4))]
    assert names == [Action.EAST, Action.EAST, Action.EAST, Action.SOUTH, Action.EAST]


@pytest.mark.parametrize(
    ("go", "expected"),
    [
        ((True, True), [Action.SOUTH, Action.EAST]),
        ((False, True), [Action.NORTH, Action.EAST]),
        ((True, False), [Action.SOUTH, Action.WEST]),
        ((False, False), [Action.NORTH, Action.WEST]),
    ],
)
def test_paths_go_where_rows_and_columns_go(go: tuple[bool, bool], expected: list[Action]) -> None:
    interest = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    case = Case(Grid(np.ones((3, 3), dtype=np.bool_), 1.0, 1.0, *go), interest, 0, -1, 1e-4)
    assert [MOVES[move] for move in case.best(8, 48)] == expected


def test_of_straight_moves_the_mean_cost_is_known() -> None:
    energies = [ENERGY.move(action).energy_j for action in REVERSE]
    finder = PathFinder(Grid(np.ones((2, 2), dtype=np.bool_)), ENERGY, Search())
    assert finder.mean_move_j == pytest.approx(sum(energies) / 4, rel=1e-12)

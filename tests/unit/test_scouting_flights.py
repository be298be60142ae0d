"""What a flight over a field costs, how fields are divided, and how tours become short."""

from __future__ import annotations

from itertools import pairwise, permutations

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.scouting.fields import Field, noise, planted
from bench.scouting.flight import ENERGY, flown, thorough_j
from bench.scouting.paths import between, serpentine, shared_out, through
from bench.scouting.rivals.lines import Lawnmower, Transects
from bench.scouting.rivals.tours import LatticeTour, RandomTour, r2_cells
from bench.scouting.tour import length_j, tour
from fleet.contexts.base import Environment
from fleet.contexts.grid import Grid
from fleet.energy.accounting import FlightCounts
from fleet.errors import MissionError
from fleet.missions.partition import parts, pieces
from fleet.spec.swarm import Action

SQUARE = Grid(np.ones((6, 8), dtype=np.bool_))


def ragged(seed: int = 0) -> Field:
    """A round field with a notch and holes."""
    rows, columns = np.mgrid[:30, :24]
    inside = ((rows - 15) / 15) ** 2 + ((columns - 12) / 12) ** 2 < 1
    inside &= ~((rows < 12) & (columns > 14))
    inside &= np.random.default_rng(seed).random(inside.shape) > 0.05
    truth = np.where(inside, rows + columns, np.nan)
    return Field(Environment("ragged", "", Grid(inside), "exg", truth))


def test_a_flight_costs_what_the_platform_counts() -> None:
    path = np.array([0, 8, 9, 10, 2, 1, 10 - 1])  # south, east, east, north, west, south
    flight = flown(SQUARE, path)
    moves = {Action.SOUTH: 2, Action.EAST: 2, Action.NORTH: 1, Action.WEST: 1}
    counts = FlightCounts(tuple(moves.get(action, 0) for action in Action), captures=6, decisions=0, steps=7)
    cost = ENERGY.flight(counts)
    assert flight.captured.tolist() == [True] * 6 + [False]
    assert (flight.total_j, flight.total_s) == pytest.approx((cost.energy_j, cost.time_s))


def test_hovering_costs_time_and_energy() -> None:
    path = np.array([0, 1, 2])
    calm, waiting = flown(SQUARE, path), flown(SQUARE, path, waited_s=np.array([0.0, 2.0, 0.0]))
    assert waiting.total_s - calm.total_s == pytest.approx(2.0)
    assert waiting.total_j - calm.total_j == pytest.approx(2.0 * ENERGY.aircraft.hover.power_w)


def test_leaps_and_captures_of_nothing_are_refused() -> None:
    with pytest.raises(ValueError, match="not neighbours"):
        flown(SQUARE, np.array([0, 2]))
    with pytest.raises(ValueError, match="not neighbours"):
        flown(SQUARE, np.array([7, 8]))  # the end of a row and the beginning of the next
    hole = Grid(np.array([[True, False, True]]))
    with pytest.raises(ValueError, match="without data"):
        flown(hole, np.array([0, 1]), np.array([True, True]))


def test_mowing_a_rectangle_from_end_to_end_costs_all_but_the_first_moves() -> None:
    field = Field(Environment("strip", "", Grid(np.ones((1, 40), dtype=np.bool_)), "exg", np.ones((1, 40))))
    flights = Lawnmower().fly(field, 4, 0, None)
    spared = 4 * ENERGY.move(Action.EAST).energy_j
    assert sum(flight.total_j for flight in flights) == pytest.approx(thorough_j(field, 4) - spared)


@pytest.mark.parametrize("agents", [1, 2, 3, 4, 5, 6, 7, 8, 100])
def test_parts_have_equally_many_cells_and_are_in_one_piece(agents: int) -> None:
    field = ragged()
    assert pieces(field.grid, field.cells) == 1
    divided = parts(field.grid, agents)
    sizes = [len(part) for part in divided]
    assert max(sizes) - min(sizes) <= 1
    assert np.array_equal(np.sort(np.concatenate(divided)), field.cells)
    if agents <= 8:
        assert [pieces(field.grid, part) for part in divided] == [1] * agents


def test_parts_are_compact() -> None:
    for part in parts(Grid(np.ones((40, 40), dtype=np.bool_)), 16):
        rows, columns = np.divmod(part, 40)
        assert (np.ptp(rows) + 1, np.ptp(columns) + 1) == (10, 10)


def test_more_agents_than_cells_are_refused() -> None:
    with pytest.raises(MissionError, match="only 48 cells"):
        parts(SQUARE, 49)


def test_the_path_between_two_cells_is_the_shortest() -> None:
    for start, end in ((0, 47), (47, 0), (7, 40), (3, 3)):
        for rows_first in (True, False):
            path = between(SQUARE, start, end, rows_first)
            rows, columns = np.abs(np.subtract(SQUARE.position(start), SQUARE.position(end)))
            assert (path[0], path[-1], len(path)) == (start, end, rows + columns + 1)
            flown(SQUARE, path)


@pytest.mark.parametrize("along_rows", [True, False])
def test_a_serpentine_over_all_lines_meets_every_cell(along_rows: bool) -> None:
    field = ragged()
    lines = range(field.grid.rows if along_rows else field.grid.columns)
    path = serpentine(field.grid, lines, along_rows)
    assert set(field.cells.tolist()) <= set(path.tolist())
    assert len(path) < 1.25 * len(field.cells)


def test_a_shared_path_is_captured_once_and_ends_at_once() -> None:
    field = ragged()
    flights = shared_out(field.grid, serpentine(field.grid, range(0, 30, 2), along_rows=True), 4)
    captured = np.concatenate([flight.cells[flight.captured] for flight in flights])
    whole = flown(field.grid, serpentine(field.grid, range(0, 30, 2), along_rows=True))
    assert np.array_equal(np.sort(captured), np.sort(whole.cells[whole.captured]))
    times = [flight.total_s for flight in flights]
    assert max(times) / np.mean(times) < 1.05


def test_agents_without_work_stay_on_the_ground() -> None:
    flights = shared_out(SQUARE, np.array([5]), 3)
    assert sum(len(flight.cells) for flight in flights) == 1
    assert sorted(flight.total_j > 0 for flight in flights) == [False, False, True]


def _shortest(stops: NDArray[np.int64]) -> float:
    return min(length_j(SQUARE, np.array(order)) for order in permutations(stops.tolist()))


def test_tours_of_few_stops_are_nearly_the_shortest() -> None:
    longer = []
    for seed in range(12):
        stops = np.random.default_rng(seed).choice(48, 6, replace=False)
        found = tour(SQUARE, stops)
        assert np.array_equal(np.sort(found), np.sort(stops))
        longer.append(length_j(SQUARE, found) / _shortest(stops))
    assert max(longer) < 1.2
    assert np.mean(longer) < 1.04


def test_a_tour_of_a_full_grid_is_nearly_the_shortest() -> None:
    grid = Grid(np.ones((14, 14), dtype=np.bool_))
    stops = np.random.default_rng(1).permutation(196)
    least = 195 * ENERGY.move(Action.EAST).energy_j
    assert least <= length_j(grid, tour(grid, stops)) <= 1.15 * least


@pytest.mark.parametrize("plan", [RandomTour(), LatticeTour(), RandomTour(True), LatticeTour(True)])
def test_tours_capture_their_budget_and_no_cell_twice(plan: RandomTour | LatticeTour) -> None:
    field = ragged()
    flights = plan.fly(field, 4, 3, 0.3)
    captured = np.concatenate([flight.cells[flight.captured] for flight in flights])
    wanted = round(0.3 * len(field.cells))
    if plan.whole_path:
        assert len(np.unique(captured)) > wanted
    else:
        assert len(captured) == len(np.unique(captured)) == wanted


def test_a_lattice_is_more_even_than_chance() -> None:
    grid = Grid(np.ones((40, 40), dtype=np.bool_))
    generator = np.random.default_rng(2)

    def largest_gap(cells: NDArray[np.int64]) -> float:
        places = np.stack(np.divmod(np.arange(1600), 40), axis=1)
        return float(np.abs(places[:, None] - places[cells][None]).sum(axis=2).min(axis=1).max())

    assert largest_gap(r2_cells(grid, 100, generator.random(2))) < largest_gap(generator.choice(1600, 100, False))


def test_transects_are_evenly_spaced_whole_lines() -> None:
    field = Field(noise(0, rows=12, columns=10))
    for along_rows, lines in ((True, 12), (False, 10)):
        plan = Transects(along_rows)
        assert len(plan.budgets(field)) == lines
        flights = plan.fly(field, 2, 5, plan.budgets(field)[2])
        captured = np.zeros(120, dtype=np.bool_)
        for flight in flights:
            captured[flight.cells[flight.captured]] = True
        full = np.flatnonzero(captured.reshape(12, 10).all(axis=1 if along_rows else 0))
        assert len(full) == 3
        assert max(after - before for before, after in pairwise(full)) <= lines // 3 + 1


def test_made_up_fields_are_what_they_say() -> None:
    doubtful = planted(1)
    assert doubtful.truth is not None
    spread = doubtful.truth.std(axis=0)
    assert spread.max() > 10 * spread.min()
    white = noise(1).truth
    assert white is not None
    assert abs(np.corrcoef(white[:, :-1].ravel(), white[:, 1:].ravel())[0, 1]) < 0.06
    assert through(SQUARE, []).size == 0

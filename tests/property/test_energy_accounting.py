from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.energy.accounting import Cost, EnergyModel, FlightCounts
from fleet.energy.profiles import load_aircraft, load_edge
from fleet.spec.swarm import Action

MOVING = EnergyModel(load_aircraft("spark-survey"), load_edge("laptop-i5"), hovering=False)
HOVERING = EnergyModel(load_aircraft("spark-survey"), load_edge("laptop-i5"), hovering=True)
number = st.integers(0, 500)
counts_of_flights = st.builds(
    FlightCounts, moves=st.tuples(*[number] * len(Action)), captures=number, decisions=number, steps=number
)


def near(cost: Cost, other: Cost) -> bool:
    return math.isclose(cost.time_s, other.time_s, rel_tol=1e-9, abs_tol=1e-9) and math.isclose(
        cost.energy_j, other.energy_j, rel_tol=1e-9, abs_tol=1e-9
    )


def test_moves_cost_what_the_direction_says() -> None:
    assert {action: MOVING.move(action) for action in Action} == {
        Action.NORTH: Cost(5.0, 127.2 * 5),
        Action.SOUTH: Cost(5.0, 130.3 * 5),
        Action.EAST: Cost(5.0, 112.9 * 5),
        Action.WEST: Cost(5.0, 112.9 * 5),
        **{
            action: Cost(5.0 * math.sqrt(2), 127.2 * 5 * math.sqrt(2))
            for action in (Action.NORTH_EAST, Action.NORTH_WEST, Action.SOUTH_EAST, Action.SOUTH_WEST)
        },
    }


def test_deciding_costs_nothing_while_moving_and_hover_power_while_hovering() -> None:
    assert MOVING.decision() == Cost()
    assert HOVERING.decision() == Cost(5.113, 57.28 * 5.113)


def test_a_flight_without_anything_is_take_off_and_landing() -> None:
    empty = FlightCounts((0,) * len(Action), 0, 0, 1)
    assert MOVING.flight(empty) == Cost(28.0, 2 * 52.8 * 14)


def test_counts_without_a_number_for_each_action_are_refused() -> None:
    with pytest.raises(ValueError, match="zip"):
        MOVING.flight(FlightCounts((1, 2), 0, 0, 1))


@given(counts_of_flights)
def test_a_flight_costs_the_sum_of_its_parts(counts: FlightCounts) -> None:
    total = HOVERING.take_off() + HOVERING.land()
    for action, moves in zip(Action, counts.moves, strict=True):
        total += Cost(HOVERING.move(action).time_s * moves, HOVERING.move(action).energy_j * moves)
    for cost, times in ((HOVERING.capture(), counts.captures), (HOVERING.decision(), counts.decisions)):
        total += Cost(cost.time_s * times, cost.energy_j * times)
    assert near(HOVERING.flight(counts), total)


@given(counts_of_flights, st.floats(0, 1e5))
def test_edge_energy_is_idle_power_and_what_tasks_take_beyond(counts: FlightCounts, time_s: float) -> None:
    captured_j = (12.71 - 2.52) * 3.240 + (14.11 - 2.52) * 1.608
    decided_j = (16.26 - 2.52) * 0.265
    expected = counts.captures * captured_j + counts.decisions * decided_j + 2.52 * time_s
    assert math.isclose(MOVING.edge_energy_j(counts, time_s), expected, rel_tol=1e-9, abs_tol=1e-9)


@given(st.floats(0, 1e5))
def test_retraining_takes_busy_power(cpu_s: float) -> None:
    assert MOVING.retraining_energy_j(cpu_s) == 16.26 * cpu_s

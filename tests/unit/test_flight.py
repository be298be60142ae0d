"""What one agent does, state by state."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from fleet.contexts.grid import Grid
from fleet.missions.flight import LAND, Choice, Decision, Flight, GroupHistory
from fleet.missions.history import ThresholdHA
from fleet.missions.layout import Layout, plan_layout
from fleet.spec.swarm import CARDINAL, Action, AgentSpec, Groups, Start, StateSpace

NORTH, SOUTH, EAST, WEST = range(4)
EVERYTHING = ThresholdHA(utility_threshold=float("inf"), visited_threshold=1000)


def layout_of(
    valid: Sequence[str], group: tuple[int, int], start: tuple[int, int] | None = None, in_transit: bool = True
) -> Layout:
    grid = Grid(np.array([[letter == "x" for letter in row] for row in valid]))
    space = StateSpace(context="field", groups=Groups(rows=group[0], columns=group[1]), capture_in_transit=in_transit)
    agent = AgentSpec(name="a", actions=CARDINAL, start=Start(row=start[0], column=start[1]) if start else None)
    return plan_layout(grid, space, [agent])


def fly(
    flight: Flight,
    prefer: Sequence[int] = (),
    reward: float = 0.0,
    finished: Callable[[], bool] | None = None,
) -> list[Decision]:
    """To the end, with the moves in `prefer` scored from best to worst."""
    scores = [float(-prefer.index(move)) if move in prefer else -99.0 for move in range(8)]
    log = []
    while not flight.landed:
        log.append(flight.decide(lambda: scores, reward, finished))
    return log


def test_sa_chooses_among_neighbours_of_the_group_that_are_not_captured() -> None:
    log = fly(Flight(layout_of(["xx", "xx"], (2, 2)), 0, EVERYTHING), prefer=[EAST, SOUTH, WEST, NORTH])
    assert log == [
        Decision(step=0, cell=0, captured=True, legal=1 << SOUTH | 1 << EAST, move=EAST),
        Decision(step=1, cell=1, captured=True, legal=1 << SOUTH, move=SOUTH),
        Decision(step=2, cell=3, captured=True, legal=1 << WEST, move=WEST),
        Decision(step=3, cell=2, captured=True, legal=0, move=LAND),
    ]


def test_the_first_of_equal_scores_is_chosen() -> None:
    log = fly(Flight(layout_of(["xxx", "xxx", "xxx"], (3, 3), start=(1, 1)), 0, EVERYTHING))
    assert log[0] == Decision(step=0, cell=4, captured=True, legal=0b1111, move=NORTH)


def test_without_a_legal_move_the_agent_travels_to_the_nearest_state_that_is_left() -> None:
    log = fly(Flight(layout_of(["xxx"], (1, 3), start=(0, 1)), 0, EVERYTHING), prefer=[EAST])
    assert [(decision.cell, decision.captured, decision.legal, decision.move) for decision in log] == [
        (1, True, 1 << EAST | 1 << WEST, EAST),
        (2, True, 0, WEST),
        (1, False, 0, WEST),
        (0, True, 0, LAND),
    ]


def test_ha_leaves_a_group_above_a_threshold_not_at_it() -> None:
    layout = layout_of(["xxxx"], (1, 3))
    at = fly(Flight(layout, 0, ThresholdHA(utility_threshold=10.0, visited_threshold=2)), prefer=[EAST])
    assert [decision.cell for decision in at] == [0, 1, 2, 3]
    above = fly(Flight(layout, 0, ThresholdHA(utility_threshold=10.0, visited_threshold=1)), prefer=[EAST])
    assert [(decision.cell, decision.legal != 0) for decision in above] == [
        (0, True),
        (1, False),
        (2, False),
        (3, False),
    ]


def test_utility_counts_moves_and_not_the_take_off_cell() -> None:
    flight = Flight(layout_of(["xxxx"], (1, 4)), 0, ThresholdHA(utility_threshold=1.5, visited_threshold=1000))
    fly(flight, prefer=[EAST], reward=1.0)
    assert (flight.utility, flight.visited, flight.cell) == ({0: 2.0}, {0: 3}, 2)


def test_travel_goes_the_longer_way_first_and_along_the_column_of_equals() -> None:
    log = fly(Flight(layout_of(["x...", "....", "...."], (1, 1), start=(2, 3)), 0, EVERYTHING))
    assert [decision.move for decision in log] == [WEST, NORTH, WEST, NORTH, WEST, LAND]
    assert [decision.captured for decision in log] == [False] * 5 + [True]


@pytest.mark.parametrize(("in_transit", "captured"), [(True, [0, 1, 2, 3]), (False, [0, 1, 3])])
def test_states_on_the_way_are_captured_when_the_spec_says_so(in_transit: bool, captured: list[int]) -> None:
    flight = Flight(
        layout_of(["xxxx"], (1, 3), in_transit=in_transit), 0, ThresholdHA(utility_threshold=10.0, visited_threshold=1)
    )
    fly(flight, prefer=[EAST])
    assert sorted(flight.captured) == captured


def test_a_start_outside_of_the_part_counts_where_it_lies_and_is_travelled_from() -> None:
    grid = Grid(np.ones((1, 4), dtype=np.bool_))
    agents = [
        AgentSpec(name="a", actions=CARDINAL),
        AgentSpec(name="b", actions=CARDINAL, start=Start(row=0, column=0)),
    ]
    layout = plan_layout(grid, StateSpace(context="field", groups=Groups(rows=1, columns=2)), agents)
    log = fly(Flight(layout, 1, EVERYTHING), prefer=[EAST])
    assert [(decision.cell, decision.captured, decision.legal) for decision in log] == [
        (0, True, 0),
        (1, True, 0),
        (2, True, 1 << EAST),
        (3, True, 0),
    ]


def test_eval_is_asked_when_a_group_is_left_and_lands_the_agent_there_before_sa_is_asked() -> None:
    asked: list[list[int]] = []
    flight = Flight(layout_of(["xxxxxxxx"], (1, 2)), 0, EVERYTHING)

    def finished() -> bool:
        asked.append(sorted(flight.captured))
        return len(asked) == 2

    log = fly(flight, prefer=[EAST], finished=finished)
    assert asked == [[0, 1], [0, 1, 2, 3]]
    assert log[-1] == Decision(step=3, cell=3, captured=True, legal=0, move=LAND)
    assert (flight.cell, flight.groups_explored) == (3, 2)


def test_eval_is_not_asked_when_the_flight_ends_anyway() -> None:
    fly(Flight(layout_of(["xx"], (1, 2)), 0, EVERYTHING), finished=lambda: pytest.fail("nothing is left to decide"))


def test_random_choices_depend_on_seed_mission_agent_and_step_alone() -> None:
    layout = layout_of(["x" * 8] * 8, (8, 8))

    def cells(seed: int, mission: int) -> list[int]:
        flight = Flight(layout, 0, EVERYTHING, seed=seed, mission=mission, exploration=1.0)
        return [decision.cell for decision in fly(flight)]

    assert cells(1, 1) == cells(1, 1)
    assert len({tuple(cells(seed, mission)) for seed in (1, 2) for mission in (1, 2)}) == 4


def test_the_two_halves_of_a_decision_are_the_decision() -> None:
    layout = layout_of(["xxx", "x.x", "xxx"], (2, 2))
    whole, halves = (Flight(layout, 0, ThresholdHA(2.0, 2)) for _ in range(2))
    log = fly(whole, prefer=[SOUTH, EAST], reward=0.5)
    again = []
    while not halves.landed:
        arrival = halves.arrive(0.5)
        choice = next((move for move in (SOUTH, EAST, NORTH, WEST) if arrival.legal >> move & 1), LAND)
        again.append(halves.leave(arrival, choice))
    assert again == log


def test_north_follows_the_grid() -> None:
    grid = Grid(np.ones((2, 1), dtype=np.bool_), rows_go_south=False)
    space = StateSpace(context="field", groups=Groups(rows=2, columns=1))
    agent = AgentSpec(name="a", actions=(Action.NORTH,))
    log = fly(Flight(plan_layout(grid, space, [agent]), 0, EVERYTHING))
    assert [(decision.cell, decision.move) for decision in log] == [(0, NORTH), (1, LAND)]


@pytest.mark.parametrize("answer", [True, False])
def test_an_arrival_says_what_eval_answered_and_that_it_was_not_asked(answer: bool) -> None:
    flight = Flight(layout_of(["xxxx"], (1, 2)), 0, ThresholdHA(float("inf"), 1))
    answers = []
    while not flight.landed:
        arrival = flight.arrive(0.0, lambda: answer)
        answers.append(arrival.finished)
        flight.leave(arrival, EAST)
    assert answers == ([None, True] if answer else [None, False, None, None])


def test_what_is_behind_in_a_group_and_where_the_agent_travels_can_be_asked() -> None:
    flight = Flight(layout_of(["xxxx"], (1, 2)), 0, ThresholdHA(float("inf"), 0))
    assert flight.target is None
    flight.decide(lambda: [0.0] * 8, reward=0.5)
    assert (flight.cell, flight.target) == (1, 2)
    flight.decide(lambda: [0.0] * 8, reward=0.5)
    assert flight.history(0) == GroupHistory(group=0, utility=0.5, visited=2, cells=2)
    assert flight.history(0).is_whole
    assert flight.history(1) == GroupHistory(group=1, utility=0.0, visited=0, cells=2)


def test_a_choice_says_whether_it_was_drawn() -> None:
    layout = layout_of(["xxx", "xxx", "xxx"], (3, 3), start=(1, 1))
    scores = [1.0, 3.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert Flight(layout, 0, EVERYTHING).choose(0b1111, scores) == Choice(SOUTH, explores=False)
    drawn = {Flight(layout, 0, EVERYTHING, seed=seed, exploration=1.0).choose(0b1011, scores) for seed in range(40)}
    assert drawn == {Choice(move, explores=True) for move in (NORTH, SOUTH, WEST)}

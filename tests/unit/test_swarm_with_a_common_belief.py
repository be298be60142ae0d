"""Agents that scout one field together, from the first capture to the landing."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest

from fleet.contexts.base import Environment
from fleet.contexts.grid import Grid
from fleet.errors import ContextError, MissionError
from fleet.functions.belief import Belief
from fleet.functions.classes import class_mean, classes, likely_values
from fleet.functions.kriging import fit, krige
from fleet.missions.layout import MOVES
from fleet.missions.partition import parts, pieces
from fleet.planning.interest import FEW
from fleet.planning.paths import STRAIGHT
from fleet.planning.rehearsal import rehearse
from fleet.planning.scouting import Ending, Scout
from fleet.planning.stop import StopRule
from fleet.planning.swarm import Swarm, Trace, scattered
from fleet.planning.tactics import InterestWeights, Search, Tactics
from tests.planning import ENERGY, Values, drawn, environment

QUICK = Tactics(search=Search(horizon=8, width=12))
LOOK = 3 * 6.0
"""Three moves and captures, in s: so long an agent flies between two looks, on open ground."""


def with_border(truth: Values) -> Values:
    """Rows and columns without data around a field."""
    return np.pad(truth, ((2, 1), (0, 2)), constant_values=np.nan)


def in_two_pieces() -> Values:
    """Two parts of a field, five columns apart."""
    truth = drawn(3, 9, 15)
    truth[:, 5:10] = np.nan
    return truth


def with_holes() -> Values:
    truth = drawn(4, 10, 11)
    truth[np.random.default_rng(4).random(truth.shape) < 0.25] = np.nan
    return truth


FIELDS = {
    "smooth": drawn(1, 10, 12),
    "border": with_border(drawn(2, 8, 9)),
    "two pieces": in_two_pieces(),
    "holes": with_holes(),
    "constant": np.full((7, 8), 5.0),
    "zero": np.zeros((6, 7)),
    "negative": -drawn(5, 7, 8),
    "one row": drawn(6, 1, 40),
    "one column": drawn(7, 25, 1),
    "eight cells": drawn(8, 2, 4),
}


@dataclass
class Sensor:
    """What is in each cell, and how often it was asked; fails without data, and when a swarm flies on and on."""

    truth: Values
    asked: Counter[int] = field(default_factory=Counter)

    def __call__(self, cell: int) -> float:
        value = float(self.truth.flat[cell])
        assert np.isfinite(value)
        self.asked[cell] += 1
        return value


class Bounded(Swarm):
    """Fails when a swarm looks so often for a path that it must be lost."""

    looks = 0

    def choose_path(self, scout: Scout) -> tuple[int, ...]:
        self.looks += 1
        assert self.looks < 20 * self.belief.cells + 200
        return super().choose_path(scout)


def flown(
    truth: Values, agents: int, tactics: Tactics = QUICK, seed: int = 0, rule: StopRule | None = None
) -> tuple[Bounded, Sensor]:
    grid, sensor = environment(truth).grid, Sensor(truth)
    swarm = Bounded(Belief(grid), ENERGY, scattered(grid, agents, seed), tactics, rule)
    swarm.fly(sensor)
    return swarm, sensor


def flight_s(grid: Grid, trace: Trace) -> float:
    """Time of a flight without its landing, from its cells alone."""
    total = ENERGY.take_off().time_s + ENERGY.capture().time_s * sum(trace.captured)
    for here, there in pairwise(trace.cells):
        move = next(move for move in MOVES[:STRAIGHT] if grid.neighbour(here, move) == there)
        total += ENERGY.move(move).time_s
    return total


@pytest.mark.parametrize("agents", [1, 3, 8])
@pytest.mark.parametrize("name", list(FIELDS))
def test_in_the_end_each_cell_with_data_is_captured_and_by_no_agent_twice(name: str, agents: int) -> None:
    truth = FIELDS[name]
    swarm, sensor = flown(truth, agents)
    own = [[cell for cell, fresh in zip(trace.cells, trace.captured, strict=True) if fresh] for trace in swarm.traces]
    captured = [cell for cells in own for cell in cells]
    assert all(len(cells) == len(set(cells)) for cells in own)
    assert sorted(set(captured)) == sorted(swarm.captured) == np.flatnonzero(np.isfinite(truth)).tolist()
    assert sensor.asked == Counter(captured)
    assert swarm.belief.captured == swarm.belief.cells == len(set(captured))
    if agents == 1:
        assert len(captured) == swarm.belief.cells


def test_a_cell_is_captured_twice_only_by_agents_that_had_not_heard_of_each_other() -> None:
    """Between two looks an agent does not hear: at most as many cells as there are moves between them."""
    twice = 0
    for seed in range(6):
        swarm, sensor = flown(drawn(seed, 12, 14), 4, seed=seed)
        again = sum(sensor.asked.values()) - swarm.belief.captured
        assert max(sensor.asked.values()) <= 4
        twice += again
    assert 0 < twice < 0.1 * 6 * 12 * 14


@pytest.mark.parametrize("agents", [1, 4])
@pytest.mark.parametrize("go", [(True, True), (False, True), (True, False), (False, False)])
def test_each_move_is_to_a_neighbour_and_the_last_one_is_that_of_the_plan(agents: int, go: tuple[bool, bool]) -> None:
    truth = with_holes()
    grid = Grid(np.isfinite(truth), 3.0, 2.0, *go)
    swarm = Swarm(Belief(grid), ENERGY, scattered(grid, agents, 1), QUICK)
    swarm.fly(Sensor(truth))
    for scout, trace in zip(swarm.scouts, swarm.traces, strict=True):
        for here, there in pairwise(trace.cells):
            assert there in [grid.neighbour(here, move) for move in MOVES[:STRAIGHT]]
        assert len(trace.cells) == len(trace.captured)
        assert scout.landed
        assert trace.ending is not None
        assert scout.cell == trace.cells[-1]
        if len(trace.cells) > 1:
            assert grid.neighbour(trace.cells[-2], MOVES[scout.last]) == trace.cells[-1]


@pytest.mark.parametrize("agents", [1, 2, 5, 8])
def test_each_agent_takes_off_in_a_part_of_its_own(agents: int) -> None:
    truth = in_two_pieces()
    grid = environment(truth).grid
    starts = [scout.cell for scout in Swarm(Belief(grid), ENERGY, scattered(grid, agents, 3), QUICK).scouts]
    divided = parts(grid, agents)
    assert [start in part for start, part in zip(starts, divided, strict=True)] == [True] * agents
    assert len(set(starts)) == agents
    swarm, _ = flown(truth, agents, seed=3)
    assert [trace.cells[0] for trace in swarm.traces] == starts


def test_a_field_in_two_pieces_is_cut_between_them() -> None:
    grid = environment(in_two_pieces()).grid
    first, second = parts(grid, 2)
    assert pieces(grid, np.concatenate((first, second))) == 2
    assert max(first % grid.columns) == 4
    assert min(second % grid.columns) == 10


def test_agents_that_find_nothing_worth_its_energy_still_get_on() -> None:
    dear = Tactics(moves=1, thrift=50.0, weights=InterestWeights(novelty=0.0), search=Search(horizon=8, width=12))
    for seed in range(20):
        truth = drawn(seed, 10, 12)
        swarm = Swarm(Belief(environment(truth).grid), ENERGY, scattered(environment(truth).grid, 5, seed), dear)
        swarm.fly(truth.item)
        assert swarm.belief.captured == truth.size
        assert sum(len(trace.cells) for trace in swarm.traces) < 10 * truth.size


def test_a_sensor_that_gives_no_number_is_named() -> None:
    grid = environment(drawn(1)).grid
    swarm = Swarm(Belief(grid), ENERGY, scattered(grid, 2, 0), QUICK)
    with pytest.raises(MissionError, match="the sensor gave nan in cell"):
        swarm.fly(lambda cell: float("nan"))


def test_the_same_seed_gives_the_same_flights_and_another_one_others() -> None:
    truth = FIELDS["smooth"]
    one, same, other = (flown(truth, 3, seed=seed)[0] for seed in (5, 5, 6))
    assert [trace.cells for trace in one.traces] == [trace.cells for trace in same.traces]
    assert one.claims == same.claims
    assert [trace.cells for trace in one.traces] != [trace.cells for trace in other.traces]


@pytest.mark.parametrize("agents", [1, 2, 8])
@pytest.mark.parametrize("goal", [0.5, 0.7])
def test_when_a_rule_ends_the_mission_all_flights_are_equally_long(agents: int, goal: float) -> None:
    truth = drawn(1, 14, 16)
    rule = StopRule(goal, 0.5)
    swarm, _ = flown(truth, agents, rule=rule)
    first = next(claim for claim in swarm.claims if rule.is_met(claim.accuracy, claim.predictions))
    assert swarm.belief.captured < swarm.belief.cells
    after = swarm.claims[swarm.claims.index(first) + 1 :]
    assert len(after) == agents - 1, "each of the others lands at its next look"
    endings = [trace.ending for trace in swarm.traces]
    assert Ending.GOAL_CLAIMED in endings
    assert set(endings) <= {Ending.GOAL_CLAIMED, Ending.ANOTHER_LANDED}
    times = [flight_s(environment(truth).grid, trace) for trace in swarm.traces]
    assert max(times) - min(times) <= LOOK
    assert min(times) <= first.time_s + ENERGY.capture().time_s


@pytest.mark.parametrize("agents", [1, 2, 8])
@pytest.mark.parametrize("name", list(FIELDS))
def test_claims_are_made_in_the_order_of_time_and_at_the_end(name: str, agents: int) -> None:
    swarm, _ = flown(FIELDS[name], agents)
    times, captured = [claim.time_s for claim in swarm.claims], [claim.captured for claim in swarm.claims]
    assert times == sorted(times)
    assert captured == sorted(captured)
    assert captured[0] == 1
    assert captured[-1] == swarm.belief.cells
    assert swarm.claims[-1].accuracy == 1.0
    assert all(0.0 <= claim.accuracy <= 1.0 for claim in swarm.claims)
    assert [claim.predictions for claim in swarm.claims] == [max(0, count - FEW) for count in captured]
    assert times[-1] <= max(flight_s(environment(FIELDS[name]).grid, trace) for trace in swarm.traces)


def test_claims_are_made_at_looks_and_one_claim_lands_each_agent() -> None:
    swarm, _ = flown(FIELDS["smooth"], 3)
    moves = sum(len(trace.cells) - 1 for trace in swarm.traces)
    assert len(swarm.claims) <= moves / QUICK.moves + 2 * len(swarm.traces)
    assert sum(trace.odometer.counts.decisions for trace in swarm.traces) == len(swarm.claims) - len(swarm.traces)


def test_claims_are_watched_one_by_one() -> None:
    truth, seen = FIELDS["smooth"], []
    swarm = Swarm(Belief(environment(truth).grid), ENERGY, scattered(environment(truth).grid, 2, 0), QUICK)

    def watch() -> bool:
        seen.append((len(swarm.claims), swarm.belief.captured))
        return False

    swarm.fly(Sensor(truth), watch)
    assert seen == [(number + 1, claim.captured) for number, claim in enumerate(swarm.claims)]


def test_a_mission_that_is_watched_ends_where_the_watcher_says() -> None:
    truth = FIELDS["smooth"]
    grid = environment(truth).grid
    swarm = Swarm(Belief(grid), ENERGY, scattered(grid, 2, 0), QUICK)
    swarm.fly(Sensor(truth), lambda: len(swarm.claims) == 7)
    assert len(swarm.claims) == 7
    assert swarm.belief.captured < swarm.belief.cells


@pytest.mark.parametrize(("moves", "thrift"), [(1, 0.0), (1, 0.7), (9, 5.0), (3, 1e6)])
def test_whatever_the_tactics_the_whole_field_is_captured(moves: int, thrift: float) -> None:
    weights = InterestWeights(doubt=1.0, doubt_around=0.0, novelty=0.0)
    for name in ("two pieces", "constant"):
        swarm, _ = flown(FIELDS[name], 2, Tactics(weights=weights, search=QUICK.search, moves=moves, thrift=thrift))
        assert swarm.belief.captured == swarm.belief.cells


@pytest.mark.parametrize("cells", [1, 2, 7])
def test_more_agents_than_cells_are_refused(cells: int) -> None:
    grid = environment(drawn(0, 1, cells)).grid
    with pytest.raises(MissionError, match=f"{cells + 1} agents but only {cells} cells with data"):
        scattered(grid, cells + 1, 0)
    with pytest.raises(MissionError, match="cells with data"):
        rehearse(environment(drawn(0, 1, cells)), ENERGY, cells + 1, QUICK, 0)


@pytest.mark.parametrize("cells", [1, 2, 7])
def test_there_may_be_an_agent_for_each_cell(cells: int) -> None:
    swarm, _ = flown(drawn(0, 1, cells), cells)
    assert [sum(trace.captured) for trace in swarm.traces] == [1] * cells


def naive_accuracy(seen: Values, place: Environment) -> float:
    """Share of the cells with the right class on a map that is made anew from the captured cells."""
    assert place.truth is not None
    mean = class_mean(place.truth, place)
    found = classes(likely_values(krige(seen, place.grid), mean), mean)
    return float((found == classes(place.truth, mean))[place.grid.valid].mean())


@pytest.mark.parametrize("name", ["smooth", "border", "eight cells", "constant", "negative"])
def test_a_rehearsal_holds_each_claim_against_the_truth(name: str) -> None:
    place = environment(FIELDS[name])
    found = rehearse(place, ENERGY, 2, QUICK, 4)
    swarm, _ = flown(FIELDS[name], 2, seed=4)
    assert found.claimed.tolist() == [claim.accuracy for claim in swarm.claims]
    assert found.predictions.tolist() == [claim.predictions for claim in swarm.claims]
    assert len(found.truth) == len(found.claimed)
    assert found.truth[-1] == 1.0


def test_the_truth_of_a_claim_is_that_of_the_map_at_that_moment() -> None:
    """With a covariance that was fitted just then the map is that of kriging from scratch."""
    truth = FIELDS["smooth"]
    place, seen = environment(truth), np.full(truth.shape, np.nan)
    swarm = Swarm(Belief(place.grid), ENERGY, scattered(place.grid, 2, 4), QUICK)
    fitted: list[float | None] = []

    def sense(cell: int) -> float:
        seen.flat[cell] = truth.flat[cell]
        return float(truth.flat[cell])

    def watch() -> bool:
        just_then = swarm.belief.variogram == fit(seen, np.isfinite(seen), place.grid)
        fitted.append(naive_accuracy(seen, place) if just_then else None)
        return False

    swarm.fly(sense, watch=watch)
    claimed = rehearse(place, ENERGY, 2, QUICK, 4).truth.tolist()
    compared = [(slow, fast) for slow, fast in zip(fitted, claimed, strict=True) if slow is not None]
    assert len(compared) >= 4
    assert [slow for slow, _ in compared] == [fast for _, fast in compared]
    assert min(slow for slow, _ in compared) < 0.7


def test_rehearsals_need_the_truth() -> None:
    grid = environment(FIELDS["smooth"]).grid
    with pytest.raises(ContextError, match="nothing is known of the truth in elsewhere"):
        rehearse(Environment("elsewhere", "", grid), ENERGY, 2, QUICK, 0)

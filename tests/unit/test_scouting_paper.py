"""The paper's swarm learns on other fields, its parts can be taken away, and what missions spend is accounted for."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from bench.scouting import paper
from bench.scouting.campaign import known
from bench.scouting.fields import MADE_UP, NAMES, NOISE, PLANTED
from bench.scouting.flight import ENERGY, thorough_j
from bench.scouting.flight import flown as flight_of
from bench.scouting.judge import How, accuracies
from bench.scouting.lessons import QUANTITY, Course, Judge, Learned, contexts, fleet_of, learn, quantities, terrain
from bench.scouting.paper import Results
from bench.scouting.paper_tables import of_arms, of_fields, of_sizes
from bench.scouting.scaffold import Arm, Outcome, Way, arms, at, flown, judged, sweep, untaught, with_equal_weights
from fleet.functions.contract import FeatureSpace, Metrics
from fleet.learning.score_tables import ALONE, NEVER, Flights, batch_of, score_table
from fleet.missions.documents import INITIAL
from fleet.simulator.batch import Flown, fly
from fleet.spec.swarm import GroupOrder

LITTLE = {"rewardShaping": {"epochs": 3, "missions": 8}, "training": {"epochs": 1, "missions": 8}}
COURSE = Course(PLANTED, 4, 0.8, settings=LITTLE)
AGENTS = 3


@cache
def _learned() -> Learned:
    return learn(COURSE)


@cache
def _untaught() -> Learned:
    return untaught(known(PLANTED, 0), AGENTS)


def _mission(learned: Learned) -> Flown:
    table = score_table({INITIAL: learned.model}, ALONE, learned.terrain)
    reward = learned.reward.model_copy(update={"utility_threshold": NEVER[0], "visited_threshold": 3})
    return fly(learned.terrain.layout, batch_of(table, reward, learned.terrain, Flights(exploration=0.5)), traced=True)


def _outcome(**figures: float) -> Outcome:
    return Outcome(**(dict.fromkeys(Outcome._fields, 0.0) | figures))


@pytest.mark.parametrize("name", MADE_UP)
def test_nothing_is_learned_on_the_field_that_is_flown(name: str) -> None:
    shaped, trained = contexts(name)
    truths = [place.truth for place in (*shaped, *trained)]
    assert len(truths) == 2
    assert not any(np.array_equal(truth, known(name, 0).truth) for truth in truths)
    assert not np.array_equal(*truths)


def test_nothing_is_learned_on_a_real_field_that_is_flown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.scouting.lessons.known", lambda name, _: name)
    for name in set(NAMES) - set(MADE_UP):
        shaped, trained = contexts(name)
        assert shaped
        assert trained
        assert not set(map(str, shaped)) & set(map(str, trained))
        assert name not in {*map(str, shaped), *map(str, trained)}


def test_features_are_in_standard_deviations_and_the_quantity_is_the_first() -> None:
    place = known(PLANTED, 0)
    assert np.array_equal(quantities(place, QUANTITY)[:, 0], place.truth)
    ssv = terrain(fleet_of(COURSE), place, QUANTITY).ssv
    assert (ssv.mean(), ssv.std()) == pytest.approx((0.0, 1.0))


def test_groups_are_those_of_the_paper() -> None:
    space = fleet_of(COURSE).state_space
    assert (space.groups.rows, space.groups.columns, space.groups.order) == (3, 3, GroupOrder.SERPENTINE)
    assert not space.capture_in_transit


@pytest.mark.parametrize("how", [How.NM, How.KR])
def test_eval_judges_the_map_of_the_captured_cells(how: How) -> None:
    place = known(PLANTED, 0)
    states = place.cells[::7]
    captured = np.isin(np.arange(place.grid.cells), states)
    fs = FeatureSpace(QUANTITY, states, np.zeros((len(states), 1)), place.environment)
    metrics = Judge(how).evaluate(fs, Metrics(())).metrics
    assert metrics["accuracy"] == accuracies(place, captured, (how,))[how]
    assert metrics["uav_energy_j"] == 0.0


def test_a_course_gives_the_same_lessons_again() -> None:
    again = learn(COURSE)
    assert again.reward == _learned().reward
    assert again.model.to_bytes() == _learned().model.to_bytes()
    assert again.reward.evaluations == 3


def test_a_sweep_captures_ever_more_cells_of_every_group_up_to_all() -> None:
    sizes = [len(cells) for cells in _untaught().terrain.layout.groups]
    found = sweep(_untaught())
    total = sum(sizes)
    assert [each.cells for each in found] == pytest.approx(
        [sum(min(size, most) for size in sizes) / total for most in range(1, 10)]
    )
    assert all(one.energy < more.energy for one, more in pairwise(found))
    assert (found[-1].nm, found[-1].kr) == (1.0, 1.0)


def test_random_moves_depend_on_the_seed_and_others_do_not() -> None:
    wander = [flown(_untaught(), [Way(1.0, (NEVER[0], 3), seed)])[0].energy for seed in (0, 0, 1)]
    assert wander[0] == wander[1] != wander[2]
    still = [flown(_untaught(), [Way(0.0, (NEVER[0], 3), seed)])[0] for seed in (0, 1)]
    assert still[0] == still[1]


def test_what_a_mission_spends_is_what_its_flights_spend() -> None:
    place, mission = known(PLANTED, 0), _mission(_untaught())
    trace = mission.trace
    assert trace is not None
    steps = trace.steps[0].tolist()
    flights = [
        flight_of(place.grid, trace.cell[0, agent, :count].astype(np.int64), trace.captured[0, agent, :count])
        for agent, count in enumerate(steps)
    ]
    found = judged(place, mission)
    assert found.energy == pytest.approx(sum(flight.total_j for flight in flights) / thorough_j(place, AGENTS))
    assert found.time_s == pytest.approx(max(flight.total_s for flight in flights))
    assert found.balance == pytest.approx(found.time_s / np.mean([flight.total_s for flight in flights]))


def test_hovering_is_paid_for_each_decision() -> None:
    place, mission = known(PLANTED, 0), _mission(_untaught())
    found, wait_s = judged(place, mission), ENERGY.edge.state_s
    hover_j = int(mission.decisions.sum()) * wait_s * ENERGY.aircraft.hover.power_w
    assert found.hover_energy == pytest.approx(hover_j / thorough_j(place, AGENTS))
    assert mission.decisions[0].min() * wait_s <= found.hover_s + 1e-6
    assert found.hover_s <= mission.decisions[0].max() * wait_s + 1e-6


def test_a_mission_between_two_of_a_sweep_is_found_by_straight_lines() -> None:
    swept = [_outcome(nm=0.5, cells=0.1, energy=0.3), _outcome(nm=0.7, cells=0.2, energy=0.5)]
    assert at(swept, "cells", 0.15)[:4] == pytest.approx((0.6, 0.0, 0.15, 0.4))
    assert at(swept, "nm", 0.65).energy == pytest.approx(0.45)
    assert at(swept, "nm", 0.4) == swept[0]
    assert np.isnan(at(swept, "nm", 0.8).cells)


def test_every_arm_is_the_papers_swarm_without_one_part() -> None:
    found, swept = arms(COURSE)
    assert set(found) == set(Arm)
    assert found[Arm.PAPER] == flown(_learned(), [Way()])[0]
    assert found[Arm.FIXED_V].cells == pytest.approx(found[Arm.PAPER].cells)
    assert found[Arm.NO_SHAPING].cells == 1.0
    assert found[Arm.RANDOM_MOVES] == flown(_learned(), [Way(exploration=1.0)])[0]
    assert len(swept) == 9


def test_equal_weights_are_given_and_only_at_one_number_of_agents() -> None:
    course = with_equal_weights(COURSE, ("one", "other"))
    assert fleet_of(course).reward_shaping.weights == {"one": 0.5, "other": 0.5}
    assert fleet_of(course).reward_shaping.epochs == 3
    assert fleet_of(COURSE).reward_shaping.weights == {}
    few, _ = arms(Course(NOISE, 1, 0.8, settings=LITTLE))
    assert Arm.EQUAL_WEIGHTS not in few


def test_results_are_read_as_they_were_written(tmp_path: Path) -> None:
    results = _results()
    paper.write(tmp_path / "out" / "paper.json", results, "it")
    again = paper.read(tmp_path / "out" / "paper.json")
    assert again == results
    assert again.figures(Arm.PAPER, 0.7, 4, "nm").tolist() == [[0.70, 0.71], [0.72, 0.73]]
    assert again.flown(4) == [Arm.PAPER, Arm.RANDOM_MOVES]


def test_tables_have_a_row_for_each_arm_field_and_size() -> None:
    results = _results()
    assert of_arms(results, 0.7, 4).row_count == 2
    assert of_fields(results, 0.7, 4).row_count == 2
    assert of_sizes(results, 0.7).row_count == 1


def _results() -> Results:
    results = Results()
    for index, (name, seed) in enumerate([("a", 0), ("a", 1), ("b", 0), ("b", 1)]):
        course = Course(name, 4, 0.7, seed=seed)
        ours = _outcome(nm=0.70 + index / 100, energy=0.5, time_s=100.0, cells=0.3)
        results.arms[course] = {Arm.PAPER: ours, Arm.RANDOM_MOVES: ours._replace(nm=0.69)}
        results.sweeps[course] = [ours]
    return results

"""What agents spend until a goal, what hovering adds to it, and what comes of learning between missions."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bench.scouting import headlines, online
from bench.scouting.campaign import known
from bench.scouting.ends import ends
from bench.scouting.fields import PLANTED
from bench.scouting.flight import ENERGY, thorough_j
from bench.scouting.headlines import CLASSIC, LAWNMOWER, OURS, PAPER, PLANNED, Case, cells, ratio, spent_in_scaffold
from bench.scouting.hover import GOALS, HOWS, WAIT_S, Asking, classic, planned, shares, table
from bench.scouting.judge import How, along
from bench.scouting.lessons import Course, learn
from bench.scouting.ours import Ours
from bench.scouting.paper import Results
from bench.scouting.scaffold import Outcome

LITTLE = {"rewardShaping": {"epochs": 2, "missions": 8}, "training": {"epochs": 1, "missions": 8}}
AGENTS = 2
HOVER_W = ENERGY.aircraft.hover.power_w


@cache
def _planned(wait_s: float) -> Asking:
    return planned(known(PLANTED, 0), AGENTS, 0, wait_s)


def test_the_watched_swarm_flies_as_the_planned_one() -> None:
    ours = Ours().fly(known(PLANTED, 0), AGENTS, 0, None)
    for watched, flight in zip(_planned(0.0).flights, ours, strict=True):
        assert np.array_equal(watched.cells, flight.cells)
        assert np.array_equal(watched.energy_j, flight.energy_j)


def test_hovering_adds_time_and_energy_where_something_is_decided() -> None:
    for plain, hovering, asked in zip(_planned(0.0).flights, _planned(2.0).flights, _planned(2.0).asked, strict=True):
        looks = np.cumsum(asked)
        assert np.allclose(hovering.time_s - plain.time_s, 2.0 * looks)
        assert np.allclose(hovering.energy_j - plain.energy_j, 2.0 * HOVER_W * looks)
        assert 0.2 < asked.mean() < 0.45


def test_classic_rl_decides_in_every_cell_that_it_captures() -> None:
    mission = classic(known(PLANTED, 0), AGENTS, 0)
    assert mission.decisions(math.inf) == sum(int(flight.captured.sum()) for flight in mission.flights)
    half = mission.flights[0].time_s[len(mission.flights[0].cells) // 2]
    assert 0 < mission.decisions(float(half)) < mission.decisions(math.inf)


def test_what_is_spent_until_a_goal_is_what_the_curve_says() -> None:
    place, flights = known(PLANTED, 0), _planned(0.0).flights
    curve = along(place, flights, (How.KR,))
    found = ends(place, flights, (0.8, 1.1), (How.NM, How.KR))
    share, energy, time_s = found[0.8, How.KR]
    assert (energy, share) == curve.reached(0.8, How.KR)
    spent_j = sum(float(flight.energy_j[flight.time_s <= time_s].max()) + flight.landing_j for flight in flights)
    assert spent_j / thorough_j(place, AGENTS) == pytest.approx(energy, abs=0.02)
    assert all(math.isnan(each) for how in (How.NM, How.KR) for each in found[1.1, how])


def test_shares_of_hovering_are_printed_for_every_swarm_and_goal() -> None:
    found = shares((PLANTED, AGENTS, 0))
    assert len(found) == 3 * len(GOALS) * len(HOWS)
    for share, decisions in found.values():
        assert 0.0 <= share <= decisions * WAIT_S * HOVER_W / ENERGY.capture().energy_j
    assert 0.3 < found["planned", 0.8, How.KR][1] < 0.4
    hover_j = WAIT_S * HOVER_W
    share, decisions = found["k-NN Classic RL", 0.8, How.NM]
    assert decisions == pytest.approx(1.0, abs=0.02)
    assert share <= hover_j / (hover_j + ENERGY.capture().energy_j)
    assert table([found, found], "planted").row_count == len(found)


def test_ratios_are_means_over_the_fields_on_which_both_reach_the_goal() -> None:
    ours, theirs = Case(PLANNED, 4, 0.7, False, How.NM), Case(CLASSIC, 1, 0.7, False, How.NM)
    tally = {
        ours: np.array([[[0.1, 10.0, 5.0]], [[0.3, 10.0, 5.0]]]),
        theirs: np.array([[[0.2, 20.0, 25.0]], [[math.nan] * 3]]),
    }
    assert ratio(tally, ours, theirs, "cells").tolist() == [2.0]
    assert ratio(tally, ours, theirs, "energy").tolist() == [2.0]
    assert ratio(tally, ours, theirs, "time").tolist() == [5.0]
    assert cells(tally, ours).tolist() == [0.2]


def test_the_papers_swarm_is_charged_for_hovering_when_it_hovers() -> None:
    place = known(PLANTED, 0)
    swept = [Outcome(each, each, each, each, 100.0, 1.0, each / 2, 50.0) for each in (0.6, 0.8)]
    results = Results(sweeps={Course(PLANTED, 4, 0.7): swept, Course(PLANTED, 4, 0.7, seed=1): []})
    found = spent_in_scaffold(results, place, 0)
    all_j = thorough_j(place, 4)
    assert found[Case(PAPER, 4, 0.7, False, How.NM)] == pytest.approx((0.7, 0.7 * all_j, 100.0))
    assert found[Case(PAPER, 4, 0.7, True, How.KR)] == pytest.approx((0.7, 1.05 * all_j, 150.0))


def test_every_published_figure_has_ours_beside_it() -> None:
    one = {swarm: np.full((2, 5, 3), figure) for swarm, figure in ((PLANNED, 1.0), (PAPER, 2.0))}
    rivals = {CLASSIC: np.full((2, 5, 3), 4.0), LAWNMOWER: np.full((2, 5, 3), 6.0)}
    tally = {
        Case(swarm, agents, goal, True, How.NM): values
        for swarm, values in {**one, **rivals}.items()
        for agents in headlines.SIZES
        for goal in headlines.GOALS
    }
    found = headlines.figures(tally, True, How.NM)
    rows = {row[0]: row[2:] for row in zip(*(column._cells for column in found.columns), strict=True)}
    assert len(found.columns) == 2 + len(OURS)
    assert rows["cells for 70 %: lawnmower / ours"] == ("3.00 [3.00, 3.00]", "6.00 [6.00, 6.00]")
    assert rows["energy to 70%: k-NN Classic RL, 1 / ours, 4: of one aircraft"][0].startswith("8.00")


def test_sa_and_reward_are_the_same_functions_in_the_fields_own_units() -> None:
    course = Course(PLANTED, 4, 0.8, settings=LITTLE)
    learned = learn(course)
    world, model = online.in_units(course, learned)
    assert np.array_equal(world.field.ssv[:, 0], known(PLANTED, 0).truth)
    assert model.scores(world.field.ssv) == pytest.approx(learned.model.scores(learned.terrain.ssv))
    assert world.reward.reward(world.field.ssv) == pytest.approx(learned.reward.reward(learned.terrain.ssv))


def test_campaigns_start_alike_and_without_learning_only_the_field_changes() -> None:
    found = online.campaigns((Course(PLANTED, 4, 0.8, settings=LITTLE), 2))
    assert set(found) == {arm.name for arm in online.ARMS}
    assert len({accuracy[0] for accuracy in found.values()}) == 1
    assert all(len(accuracy) == 2 for accuracy in found.values())


def test_rises_are_held_against_missions_without_learning(tmp_path: Path) -> None:
    plain, learning, best = (arm.name for arm in online.ARMS)
    found = {
        Course("a", 4, 0.8, seed=seed): {plain: [0.6, 0.5], learning: [0.6, 0.6], best: [0.6, 0.7]} for seed in (0, 1)
    }
    shown = online.table(found)
    columns = [column._cells for column in shown.columns]
    assert columns[4] == ["-10.0", "+0.0", "+10.0"]
    assert columns[5] == ["", "+10.0 [+10.0, +10.0]", "+20.0 [+20.0, +20.0]"]
    assert columns[6][2].startswith("+50.0")  # the error fell by a quarter, and rose by a quarter without
    online.write(tmp_path / "online.json", found, "it")
    assert online.read(tmp_path / "online.json") == found

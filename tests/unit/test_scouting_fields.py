"""Every real field is flown, and means are told over the fields of the aims."""

from __future__ import annotations

import csv
import io
import json
import re
from argparse import Namespace
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from bench.scouting import headlines, online, paper, sizes, stops
from bench.scouting.fields import AIMED, CORN, MADE_UP, NAMES, REAL, averaged_over, data_folder, field
from bench.scouting.headlines import Case
from bench.scouting.judge import How
from bench.scouting.lessons import Course, contexts
from bench.scouting.paper import HOWS, SIZED_AT, Results, courses
from bench.scouting.paper_plots import draw, picture
from bench.scouting.scaffold import WEIGHED_AT, Arm, Outcome
from bench.scouting.stops import Row

FULL = Namespace(short=False, goals=None, agents=None, seeds=None, hows=list(HOWS), fields=list(REAL))


def _results() -> Results:
    """Two goals, four sizes on six fields; accuracy and energy differ by goal, field and arm, time by size."""
    results = Results()
    for course in courses(Namespace(**{**vars(FULL), "goals": [0.7, 0.9], "seeds": 5})):
        level = course.goal + 0.01 * REAL.index(course.field) + 0.001 * course.seed
        ours = Outcome(level, level + 0.02, 0.3, level / 2, 100.0 / course.agents, 1.0, 0.1, 2.0)
        results.arms[course] = {Arm.PAPER: ours, Arm.RANDOM_MOVES: ours._replace(nm=ours.nm - 0.05)}
        results.sweeps[course] = [ours]
    return results


def test_all_real_fields_are_known_by_name_and_none_is_made_up() -> None:
    assert (*REAL, *MADE_UP) == NAMES
    assert set(AIMED) < set(REAL)
    assert averaged_over(NAMES) == list(AIMED)
    assert averaged_over(["lasrosas", "gartner"]) == ["lasrosas", "gartner"]


def test_both_seasons_of_lasrosas_are_the_means_of_their_own_points() -> None:
    try:
        file = data_folder() / "yield" / "lasrosas.corn.txt"
    except FileNotFoundError:
        pytest.skip("the real data is not here")
    with file.open(newline="") as points:
        rows = list(csv.DictReader(points, delimiter="\t"))
    for name, year in (("lasrosas", "2001"), ("lasrosas-1999", "1999")):
        place, mine = field(name), [float(row["yield"]) for row in rows if row["year"] == year]
        assert place.name == name
        assert min(mine) <= np.nanmin(place.truth) < np.nanmax(place.truth) <= max(mine)
        assert np.nanmean(place.truth) == pytest.approx(np.mean(mine), rel=0.02)
        assert 2.5 < len(mine) / len(place.cells) < 3.1


def test_on_dates_of_the_corn_field_is_shaped_and_trained_before_another_field_is_flown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("bench.scouting.lessons.known", lambda name, _: name)
    for name in sorted(set(REAL) - set(CORN)):
        shaped, trained = ([str(each) for each in part] for part in contexts(name))
        assert set(shaped) & set(CORN)
        assert set(trained) & set(CORN)
        assert sorted([*shaped, *trained, name]) == sorted(REAL)


def test_the_papers_swarm_flies_every_real_field_with_ten_seeds_shaped_by_both_maps() -> None:
    wanted = courses(FULL)
    assert len(set(wanted)) == len(wanted)
    flown = Counter((course.field, course.goal, course.agents, course.how) for course in wanted)
    assert set(flown.values()) == {10}
    expected = {(name, goal, WEIGHED_AT, how) for name in REAL for goal in paper.GOALS for how in HOWS}
    expected |= {(name, goal, size, How.NM) for name in REAL for goal in SIZED_AT for size in paper.SIZES}
    assert set(flown) == expected


def test_results_are_told_apart_by_map_goal_and_field() -> None:
    results = _results()
    kriged = results.shaped_by(How.KR).to(0.9).on(["gartner", "lasrosas"])
    assert (kriged.hows, kriged.goals, kriged.sizes) == ([How.KR], [0.9], [4])
    assert kriged.fields == ["gartner", "lasrosas"]
    assert set(kriged.sweeps) == set(kriged.arms)
    assert results.shaped_by(How.NM).sizes == [1, 2, 4, 8]


def test_the_picture_shows_where_arms_end_and_how_much_sooner_more_agents_are_done(tmp_path: Path) -> None:
    figure = picture(_results())
    nm, kr, speed = figure.axes
    ours, random = nm.lines[:2]
    of_aims = 100 * (0.7 + 0.01 * 1.5 + 0.002)
    assert np.asarray(ours.get_ydata()) == pytest.approx([of_aims, of_aims + 20])
    assert np.asarray(ours.get_xdata()) == pytest.approx([of_aims / 2, of_aims / 2 + 10])
    assert np.asarray(random.get_ydata()) == pytest.approx([of_aims - 5, of_aims + 15])
    assert np.asarray(kr.lines[0].get_ydata()) == pytest.approx([of_aims + 2, of_aims + 22])
    assert len(speed.lines) == 3
    assert np.asarray(speed.lines[0].get_ydata()) == pytest.approx([1.0, 2.0, 4.0, 8.0])
    draw(_results(), tmp_path / "paper.png")
    assert (tmp_path / "paper.png").read_bytes().startswith(b"\x89PNG")


def test_sizes_are_told_for_every_field_and_averaged_over_those_of_the_aims() -> None:
    flown = {
        (name, size, seed): (1000.0 / size if name in AIMED else 10.0, 5.0, 1.0)
        for name in REAL for size in sizes.SIZES for seed in (0, 1)
    }  # fmt: skip
    shown = sizes.table(flown, How.KR)
    rows = list(zip(*(column._cells for column in shown.columns), strict=True))
    assert [row[0] for row in rows] == [*REAL, "mean of 4"]
    assert rows[-1][1:] == ("2.00, 1.00, 1.000", "4.00, 1.00, 1.000", "8.00, 1.00, 1.000")
    assert rows[-2][1].startswith("1.00")


def test_stops_are_averaged_over_the_fields_of_the_aims(capsys: pytest.CaptureFixture[str]) -> None:
    stops.show([Row(name, goal, 0.5, float(name in AIMED), 1.5, 0.01, 0.02) for goal in stops.GOALS for name in REAL])
    means = [line for line in capsys.readouterr().out.splitlines() if "mean of 4" in line]
    assert len(means) == len(stops.GOALS)
    assert all("100.0%" in line and "1.50" in line for line in means)


def test_learning_between_missions_is_told_for_the_aims_together_and_for_each_other_field() -> None:
    plain = {arm.name: [0.6, 0.7] for arm in online.ARMS}
    found = {
        Course(name, 4, 0.8, seed=seed): plain if name in AIMED else {**plain, online.ARMS[1].name: [0.6, 0.8]}
        for name in REAL for seed in (0, 1)
    }  # fmt: skip
    console = Console(width=200, record=True, file=io.StringIO())
    online.show(found, console)
    _, *tables = re.split(r"^ +(?=2018|lasrosas)", console.export_text(), flags=re.MULTILINE)
    assert [each.split("\n")[0].strip() for each in tables] == [", ".join(AIMED), "lasrosas", "lasrosas-1999"]
    assert ["+10.0 [+10.0, +10.0]" in each for each in tables] == [False, True, True]


def test_headlines_are_told_for_the_aims_and_for_the_others() -> None:
    cases = [
        Case(swarm, agents, goal, hovering, how)
        for swarm in (*headlines.OURS, headlines.CLASSIC, headlines.LAWNMOWER)
        for agents in headlines.SIZES for goal in headlines.GOALS for hovering in (True, False) for how in HOWS
    ]  # fmt: skip
    share = np.where(np.isin(REAL, AIMED), 0.25, 0.5)
    found = {case: np.broadcast_to(share[:, None, None], (len(REAL), 2, 3)) for case in cases}
    console = Console(width=200, record=True, file=io.StringIO())
    headlines.show(found, REAL, console)
    told = [line for line in console.export_text().splitlines() if "cells for 70 %  " in line]
    assert ["25.0 % [25.0, 25.0]" in line for line in told] == [True] * 4 + [False] * 4
    assert ["50.0 % [50.0, 50.0]" in line for line in told] == [False] * 4 + [True] * 4
    written = json.loads(json.dumps(headlines.document(found, REAL)))
    assert written["fields"] == list(REAL)
    assert len(written["runs"]) == len(cases)
    assert written["runs"][0]["spent"][0][0] == [0.25] * 3

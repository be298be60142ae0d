"""Curves over energy, the goals that they reach, and differences with their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from bench.scouting.campaign import Job, flown, jobs, read, write
from bench.scouting.fields import REAL, Field, data_folder, field, noise
from bench.scouting.flight import Flights, thorough_j
from bench.scouting.flight import flown as flight_of
from bench.scouting.judge import CHECKPOINTS, Curve, How, accuracies, along, judged, over_budgets, progress
from bench.scouting.paths import serpentine, shared_out
from bench.scouting.rivals.lines import Lawnmower, Transects
from fleet.functions.classes import classes, likely_values
from fleet.functions.kriging import krige

CELLS = {
    "2018-06-01": 2106,
    "2018-08-02": 1278,
    "2018-09-16": 1787,
    "gartner": 2740,
    "lasrosas": 638,
    "lasrosas-1999": 582,
}


def smooth_field() -> Field:
    """A hill."""
    environment = noise(0, rows=16, columns=20)
    rows, columns = np.mgrid[:16, :20]
    assert environment.truth is not None
    environment.truth[:] = 100 + 40 * np.sin(rows / 5) * np.cos(columns / 6)
    return Field(environment)


def curve_of(values: Sequence[float]) -> Curve:
    accuracy = np.interp(CHECKPOINTS, np.linspace(0.02, 1.0, len(values)), values)
    return Curve(CHECKPOINTS.copy(), {How.KR: accuracy}, 1.0, 1.0, 1.0)


def captured_at(field: Field, flights: Flights, energy: float) -> set[int]:
    """The plain way: step through the time, second by second."""
    limit = energy * thorough_j(field, len(flights)) - sum(flight.landing_j for flight in flights)
    found: set[int] = set()
    for second in range(int(max(flight.time_s[-1] for flight in flights)) + 2):
        done = [flight.time_s <= second for flight in flights]
        spent = sum(float(f.energy_j[now][-1]) for f, now in zip(flights, done, strict=True) if now.any())
        if spent > limit:
            return found
        for each, now in zip(flights, done, strict=True):
            found |= set(each.cells[now & each.captured].tolist())
    return found


def test_captures_so_far_are_those_of_all_agents_at_the_same_time() -> None:
    field = smooth_field()
    flights = shared_out(field.grid, serpentine(field.grid, range(16), along_rows=True), 3)
    energy, cells = progress(field, flights)
    for checkpoint in (0.1, 0.33, 0.8):
        now = cells[: np.searchsorted(energy, checkpoint, side="right")]
        slow = captured_at(field, flights, checkpoint)
        assert len(set(now[now >= 0].tolist()) ^ slow) <= 3  # agents act within the same second
    assert energy[-1] == pytest.approx(sum(flight.total_j for flight in flights) / thorough_j(field, 3))


def test_a_curve_has_the_accuracy_of_what_was_captured_by_then() -> None:
    field = smooth_field()
    flights = Lawnmower().fly(field, 2, 0, None)
    curve = along(field, flights)
    at = 40
    energy, cells = progress(field, flights)
    captured = np.zeros(field.grid.cells, dtype=np.bool_)
    now = cells[energy <= CHECKPOINTS[at]]
    captured[now[now >= 0]] = True
    assert curve.cells[at] == pytest.approx(captured.mean())
    assert {how: values[at] for how, values in curve.accuracy.items()} == accuracies(field, captured)
    assert curve.accuracy[How.NM][-1] == 1.0


def test_a_map_of_nothing_is_wrong_everywhere_and_a_full_one_nowhere() -> None:
    field = smooth_field()
    none = np.zeros(field.grid.cells, dtype=np.bool_)
    assert accuracies(field, none) == dict.fromkeys(How, 0.0)
    assert accuracies(field, ~none) == dict.fromkeys(How, 1.0)


def test_classes_refer_to_the_true_mean_or_to_that_of_the_map() -> None:
    field = smooth_field()
    poor = field.truth < np.quantile(field.truth, 0.3)  # who has seen these only takes the field for poor
    found = accuracies(field, poor)
    prediction = krige(field.seen(poor), field.grid)
    truth = field.truth.reshape(prediction.values.shape)
    own = float(prediction.values.mean())
    assert own < 0.9 * truth.mean()
    for mean, expected, probable in ((truth.mean(), How.KR, How.LIKELY), (own, How.KR_OWN, How.LIKELY_OWN)):
        for how, values in ((expected, prediction.values), (probable, likely_values(prediction, mean))):
            assert found[how] == pytest.approx((classes(values, mean) == classes(truth, truth.mean())).mean())
    assert found[How.KR_OWN] != found[How.KR]


def test_budgets_are_judged_at_the_end_of_each_mission() -> None:
    field = smooth_field()
    plan = Transects(along_rows=True)
    missions = [plan.fly(field, 2, 0, budget) for budget in (0.25, 0.5, 1.0)]
    curve = over_budgets(field, missions)
    ends = [sum(flight.total_j for flight in flights) / thorough_j(field, 2) for flights in missions]
    assert np.isnan(curve.cells[ends[0] > CHECKPOINTS]).all()
    captured = np.zeros(field.grid.cells, dtype=np.bool_)
    for flight in missions[1]:
        captured[flight.cells[flight.captured]] = True
    nearest = np.interp(ends[1], CHECKPOINTS, curve.accuracy[How.KR])
    assert nearest == pytest.approx(accuracies(field, captured)[How.KR], abs=0.01)
    assert curve.ended == ends[2]


def test_a_goal_is_reached_where_a_straight_curve_crosses_it() -> None:
    assert curve_of([0.5, 1.0]).reached(0.75, How.KR) == pytest.approx((0.51, 0.51), abs=0.002)


def test_one_lucky_point_reaches_no_goal() -> None:
    curve = curve_of([0.5, 0.9])
    curve.accuracy[How.KR][10] += 0.2
    assert curve.reached(0.7, How.KR)[0] == pytest.approx(curve_of([0.5, 0.9]).reached(0.7, How.KR)[0])


def test_noise_moves_a_crossing_neither_way() -> None:
    generator = np.random.default_rng(0)
    found = []
    for _ in range(300):
        curve = curve_of([0.4, 1.0])
        curve.accuracy[How.KR] += generator.normal(0, 0.004, len(CHECKPOINTS))
        found.append(curve.reached(0.8, How.KR)[0])
    assert np.mean(found) == pytest.approx(curve_of([0.4, 1.0]).reached(0.8, How.KR)[0], abs=0.003)


def test_a_goal_that_is_never_met_has_no_energy() -> None:
    assert np.isnan(curve_of([0.2, 0.6]).reached(0.7, How.KR)).all()


def test_accuracy_at_equal_cells_is_read_between_the_points() -> None:
    curve = curve_of([0.5, 1.0])
    assert curve.at_cells(0.51, How.KR) == pytest.approx(0.75)
    assert np.isnan(curve.at_cells(1.5, How.KR))


def test_results_are_read_as_they_were_written(tmp_path: Path) -> None:
    wanted = jobs(["lawnmower"], ["noise"], 2, 1)
    curves = flown(wanted, 1, lambda done, job: None)
    file = tmp_path / "scouting.json"
    write(file, curves, "here")
    again = read(file)
    assert list(again) == [Job("lawnmower", "noise", 2, 0)]
    np.testing.assert_allclose(again[wanted[0]].accuracy[How.NM], curves[wanted[0]].accuracy[How.NM], atol=1e-5)


def test_on_white_noise_no_rival_beats_another_at_equal_cells() -> None:
    place = field("noise")
    mowed = judged(Lawnmower(), place, 2, 0, [How.NM])
    lines = judged(Transects(along_rows=False), place, 2, 0, [How.NM])
    for share in (0.3, 0.5, 0.7):
        assert lines.at_cells(share, How.NM) == pytest.approx(mowed.at_cells(share, How.NM), abs=0.03)


@pytest.mark.parametrize("name", REAL)
def test_real_fields_have_as_many_cells_as_were_published_or_counted(name: str) -> None:
    try:
        data_folder()
    except FileNotFoundError:
        pytest.skip("the real data is not here")
    place = field(name)
    assert len(place.cells) == pytest.approx(CELLS[name], rel=0.01 if name == "gartner" else 0)
    assert np.isfinite(place.truth[place.cells]).all()


def test_an_agent_that_stays_on_the_ground_costs_nothing() -> None:
    place = smooth_field()
    idle = flight_of(place.grid, np.zeros(0, dtype=np.int64))
    flights = (*Lawnmower().fly(place, 1, 0, None), idle)
    assert idle.total_j == 0.0
    assert along(place, flights, [How.NM]).accuracy[How.NM][-1] == 1.0

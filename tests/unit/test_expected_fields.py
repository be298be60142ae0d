"""What earlier missions make expect of a field: how far maps and beliefs follow it, and what it does to missions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fleet.contexts.base import Expectation
from fleet.functions.belief import Belief
from fleet.functions.external_drift import slope
from fleet.functions.extrapolation import Extrapolation, extrapolate
from fleet.planning.stop import StopRule
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import Tactics
from fleet.runtime.remembering import filled, found, kept_environment, stored_environment
from fleet.storage.local import LocalStorage
from tests.planned_flights import PATHS, fly, prepared, put, settings_of, simulated, spec_of
from tests.planning import ENERGY, Values, drawn, environment


def scene(seed: int, alike: float, share: float = 0.15) -> tuple[Values, Values, Values]:
    """A field, what was expected of it, and what was captured; they are correlated by `alike`."""
    truth, other = drawn(seed, 20, 22), drawn(seed + 100, 20, 22)
    expected = alike * (truth - truth.mean()) + (1.0 - alike**2) ** 0.5 * (other - other.mean())
    captured = np.where(np.random.default_rng(seed).random(truth.shape) < share, truth, np.nan)
    return truth, expected, captured


def certain(values: Values) -> Expectation:
    return Expectation(values, np.zeros(values.shape))


def error(truth: Values, map_: Values) -> float:
    return float(np.abs(map_ - truth).mean())


def test_the_slope_is_that_of_the_line_less_what_chance_explains() -> None:
    generator = np.random.default_rng(1)
    expected = generator.normal(size=400)
    values = 3.0 + 2.0 * expected + generator.normal(0.0, 0.1, size=400)
    line = float(np.polyfit(expected, values, 1)[0])
    assert slope(values, expected) == pytest.approx(line, rel=1e-3)
    assert slope(values, expected) < line


def test_what_has_nothing_to_do_with_a_field_is_given_hardly_any_weight() -> None:
    generator = np.random.default_rng(2)
    found = [slope(generator.normal(size=60), generator.normal(size=60)) for _ in range(200)]
    assert np.mean(np.array(found) == 0.0) > 0.9
    assert np.mean(np.abs(found)) < 0.03


@pytest.mark.parametrize("values", [np.ones(30), np.arange(11.0)])
def test_there_is_no_slope_where_nothing_can_be_told(values: Values) -> None:
    assert slope(values, np.arange(float(len(values)))) == 0.0


@pytest.mark.parametrize("how", list(Extrapolation))
@pytest.mark.parametrize("seed", range(3))
def test_an_expectation_that_is_nearly_right_makes_a_better_map(how: Extrapolation, seed: int) -> None:
    truth, expected, captured = scene(seed, alike=0.95)
    grid = environment(truth).grid
    plain = extrapolate(captured, grid, how).values
    told = extrapolate(captured, grid, how, expected=certain(1000.0 + 0.1 * expected)).values
    assert error(truth, told) < 0.7 * error(truth, plain)
    seen = np.isfinite(captured)
    assert np.array_equal(told[seen], captured[seen])


@pytest.mark.parametrize("seed", range(5))
def test_an_expectation_of_another_field_does_little_harm(seed: int) -> None:
    truth, expected, captured = scene(seed, alike=0.0)
    grid = environment(truth).grid
    plain, told = (extrapolate(captured, grid, expected=each).values for each in (None, certain(expected)))
    assert error(truth, told) < 1.05 * error(truth, plain)


def test_a_belief_that_expects_something_is_the_map_that_expects_it() -> None:
    truth, values, captured = scene(4, alike=0.9)
    expected = Expectation(values, np.random.default_rng(0).uniform(0.0, 5.0, truth.shape))
    place = replace(environment(truth), expected=expected)
    belief, cells = Belief.over(place), np.flatnonzero(np.isfinite(captured))
    belief.observe(cells, captured.flat[cells])
    wanted = extrapolate(captured, place.grid, expected=expected)
    np.testing.assert_allclose(belief.prediction().values, wanted.values, rtol=1e-9)
    np.testing.assert_allclose(belief.prediction().deviation, wanted.deviation, rtol=1e-9)
    assert belief.class_mean == pytest.approx(wanted.values.mean())


def test_a_belief_follows_captures_one_by_one_as_all_at_once() -> None:
    truth, expected, captured = scene(5, alike=0.9)
    place = replace(environment(truth), expected=certain(expected))
    cells = np.flatnonzero(np.isfinite(captured))[:16]
    one, all_ = Belief.over(place), Belief.over(place)
    for cell in cells:  # the last fit is to all sixteen, or to fifteen of them
        one.observe([cell], [captured.flat[cell]])
    all_.observe(cells, captured.flat[cells])
    assert np.abs(one.prediction().values - all_.prediction().values).max() < 0.5 * truth.std()
    assert np.array_equal(one.prediction().values.flat[cells], captured.flat[cells])


def test_a_place_without_expectations_is_believed_in_as_before() -> None:
    truth, _, captured = scene(6, alike=0.9)
    place, cells = environment(truth), np.flatnonzero(np.isfinite(captured))
    plain, flat = Belief(place.grid), Belief(place.grid, expected=certain(np.full(truth.shape, 7.0)))
    for belief in (plain, flat):
        belief.observe(cells, captured.flat[cells])
    assert np.array_equal(plain.prediction().values, flat.prediction().values)


def campaign(seed: int, missions: int, remembers: bool) -> list[float]:
    """Energy of one mission after the other over a field that drifts a little, each until its map is good enough."""
    generator, truth = np.random.default_rng(seed), drawn(seed, 24, 26)
    place, spent = environment(truth), []
    for number in range(missions):
        scouts = scattered(place.grid, 2, 100 * seed + number)
        swarm = Swarm(Belief.over(place), ENERGY, scouts, Tactics(), StopRule(0.75, 1.0))
        swarm.fly(truth.item)
        spent.append(swarm.spent_j)
        captured = np.full(truth.shape, np.nan)
        captured.flat[swarm.captured] = truth.flat[swarm.captured]
        map_ = found(place, captured)
        truth = truth + generator.normal(0.0, 0.05 * truth.std(), truth.shape)
        place = replace(environment(truth), expected=map_ if remembers else None)
    return spent


def test_goals_come_nearer_from_mission_to_mission_because_missions_remember() -> None:
    with_memory, without = (
        np.mean([campaign(seed, 4, remembers) for seed in range(4)], axis=0) for remembers in (True, False)
    )
    assert with_memory[0] == without[0]
    assert with_memory[-1] < 0.75 * with_memory[0]
    assert with_memory[-1] < 0.75 * without[-1]


def second_mission(storage: LocalStorage) -> None:
    """Prepare another mission over the same place."""
    order = settings_of(storage, "agent-1").order
    put(storage, PATHS.plan(2), order.model_copy(update={"number": 2}))


def expected_by(storage: LocalStorage) -> Expectation | None:
    settings = settings_of(storage, "agent-1").at_mission(2)
    plain = replace(stored_environment(settings.at_mission(1)), expected=None)
    return kept_environment(settings, plain).expected


def test_a_mission_expects_the_map_that_the_last_one_left(tmp_path: Path) -> None:
    storage = prepared(tmp_path)
    fly(storage)
    second_mission(storage)
    flown = simulated(storage)
    truth = stored_environment(settings_of(storage, "agent-1")).truth
    assert truth is not None
    captured = np.full(truth.shape, np.nan)
    captured.flat[flown.captured] = truth.flat[flown.captured]
    wanted = extrapolate(captured, flown.grid)
    expected = expected_by(storage)
    assert expected is not None
    np.testing.assert_array_equal(expected.values, wanted.values)
    np.testing.assert_array_equal(expected.deviation, wanted.deviation)
    assert (expected.deviation.flat[flown.captured] == 0.0).all()
    again = stored_environment(settings_of(storage, "agent-2").at_mission(2)).expected
    assert again is not None
    np.testing.assert_array_equal(again.values, expected.values)


@pytest.mark.parametrize(
    "changes", [{"onlineLearning": {"memory": False}}, {"sa": {"kind": "QLearning"}}], ids=["switched off", "in groups"]
)
def test_some_missions_expect_nothing(tmp_path: Path, changes: dict[str, object]) -> None:
    storage = prepared(tmp_path)
    fly(storage)
    second_mission(storage)
    put(storage, PATHS.fleet_spec, spec_of(3, **changes))
    assert expected_by(storage) is None


def test_cells_that_nobody_has_seen_are_expected_with_less_certainty() -> None:
    truth, values, captured = scene(7, alike=0.97)
    deviation = np.where(np.arange(truth.size).reshape(truth.shape) % 2, 8.0, 0.0)
    map_ = extrapolate(captured, environment(truth).grid, expected=Expectation(values, deviation))
    plain = extrapolate(captured, environment(truth).grid, expected=certain(values))
    line = slope(captured[np.isfinite(captured)], values[np.isfinite(captured)])
    free = ~np.isfinite(captured)
    wanted = np.hypot(plain.deviation, line * deviation)
    np.testing.assert_allclose(map_.deviation[free], wanted[free])
    assert (map_.deviation[~free] == 0.0).all()
    np.testing.assert_array_equal(map_.values, plain.values)


def test_of_cells_that_had_no_data_the_mean_and_the_range_of_the_others_are_expected() -> None:
    known = np.array([[True, True, False]])
    found_there = filled(Expectation(np.array([[1.0, 3.0, np.nan]]), np.array([[0.0, 0.5, np.nan]])), known)
    assert found_there.values.tolist() == [[1.0, 3.0, 2.0]]
    assert found_there.deviation.tolist() == [[0.0, 0.5, 1.0]]

"""Built-in parts of Eval(): on fields that are small enough to count by hand, and on few or no samples."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.extrapolation import group_walks, likely
from bench.scouting.fields import corn
from fleet.contexts.base import Environment
from fleet.contexts.grid import Grid
from fleet.functions.classes import class_mean, class_probabilities, classes, expected_accuracy, likely_values
from fleet.functions.clients import open_eval
from fleet.functions.contract import AgentMetrics, FeatureSpace, Metrics
from fleet.functions.evaluation import coverage, error_map, evaluation_metrics, truth_metrics, yield_map
from fleet.functions.extrapolation import Extrapolation, extrapolate
from fleet.functions.kriging import Prediction
from fleet.spec.functions import EvalSpec
from tests.function_servers import EXAMPLE

NAN = np.nan
METRICS = Metrics((AgentMetrics("a", 3, 2, 10.0, 100.0, 7.0, 4, 4), AgentMetrics("b", 3, 2, 12.5, 50.0, 3.0, 4, 4)))


def environment(truth: list[list[float]] | NDArray[np.float64], known: bool = True) -> Environment:
    values = np.array(truth, dtype=float)
    return Environment("field", "d", Grid(np.isfinite(values), 10.0, 10.0), "exg", values if known else None)


def captured(place: Environment, states: list[int], truth: NDArray[np.float64]) -> FeatureSpace:
    cells = np.array(sorted(states), dtype=np.int64)
    return FeatureSpace(("exg",), cells, truth.reshape(-1)[cells][:, None], place)


def test_classes_count_the_thresholds_that_are_exceeded() -> None:
    values = np.array([[7.9, 8.0, 8.1, 9.1], [10.0, 10.1, 99.0, NAN]])
    np.testing.assert_array_equal(classes(values, 10.0), [[0, 0, 1, 2], [2, 3, 3, NAN]])


def test_classes_are_in_order_of_the_value_when_the_mean_is_negative() -> None:
    values = np.array([-12.0, -9.5, -8.5, -7.0])
    assert classes(values, -10.0).tolist() == [0.0, 1.0, 2.0, 3.0]


def test_classes_refer_to_the_true_mean_when_it_is_known() -> None:
    predicted = np.array([[1.0, 2.0, NAN]])
    assert class_mean(predicted, environment([[10.0, 30.0, NAN]])) == 20.0
    assert class_mean(predicted, environment([[10.0, 30.0, NAN]], known=False)) == 1.5
    assert class_mean(np.full((1, 3), NAN), environment([[10.0, 30.0, NAN]], known=False)) == 0.0


def test_yield_is_a_line_of_the_feature() -> None:
    truth = np.array([[1.0, 2.0], [3.0, 4.0]])
    fs = captured(environment(truth), [0, 3], truth)
    np.testing.assert_array_equal(yield_map(fs, "exg", 2.0, 1.0), [[3.0, NAN], [NAN, 9.0]])
    with pytest.raises(KeyError, match="Map\\(\\) gives no feature 'ndvi'; it gives exg"):
        yield_map(fs, "ndvi")


def test_metrics_of_a_map_that_is_counted_by_hand() -> None:
    truth = np.array([[8.0, 12.0, NAN], [10.0, 10.0, 10.0]])  # mean 10: classes 0 3 - / 2 2 2
    predicted = np.array([[8.0, 9.5, NAN], [10.0, NAN, 9.5]])  #                  0 2 - / 2 - 2
    place = environment(truth)
    fs = captured(place, [0, 3], truth)
    assert evaluation_metrics(predicted, fs, METRICS) == pytest.approx(
        {
            "accuracy": 3 / 5,
            "mae": (0 + 2.5 + 0 + 0.5) / 4,
            "coverage": 2 / 5,
            "time_s": 12.5,
            "uav_energy_j": 150.0,
            "edge_energy_j": 10.0,
            "energy_j": 160.0,
        }
    )
    np.testing.assert_array_equal(error_map(predicted, place), [[0.0, -2.5, NAN], [0.0, NAN, -0.5]])


def test_without_truth_there_is_no_accuracy() -> None:
    place = environment([[1.0, 2.0]], known=False)
    assert truth_metrics(np.array([[1.0, 2.0]]), place) == {}
    assert np.isnan(error_map(np.array([[1.0, 2.0]]), place)).all()


def test_a_state_that_is_captured_twice_counts_once() -> None:
    place = environment([[1.0, 2.0]])
    fs = FeatureSpace(("exg",), np.array([1, 1]), np.array([[2.0], [2.0]]), place)
    assert coverage(fs) == {"coverage": 0.5}


def test_a_sure_prediction_has_its_own_class() -> None:
    values = np.array([[7.0, 8.5, 9.5, 11.0, NAN]])
    prediction = Prediction(values, np.where(np.isnan(values), NAN, 0.0))
    probabilities = class_probabilities(prediction, 10.0)
    np.testing.assert_array_equal(probabilities[:, 0, :4], np.eye(4))
    np.testing.assert_array_equal(likely_values(prediction, 10.0), values)
    assert expected_accuracy(prediction, 10.0) == {"expected_accuracy": 1.0}


def test_an_unsure_prediction_moves_to_the_nearest_value_of_its_likely_class() -> None:
    prediction = Prediction(np.array([[9.6, 8.9, 8.5]]), np.array([[5.0, 5.0, 0.1]]))
    moved = likely_values(prediction, 10.0)
    assert moved[0].tolist() == [np.nextafter(10.0, np.inf), 8.0, 8.5]
    assert classes(moved, 10.0)[0].tolist() == [3.0, 0.0, 1.0]


@pytest.mark.parametrize("how", Extrapolation)
@pytest.mark.parametrize("states", [[], [0], [7], [0, 11], [3, 4], list(range(12))])
@pytest.mark.parametrize("field", ["sloped", "constant", "zero", "holes"])
def test_every_extrapolation_takes_few_samples_and_odd_fields(
    how: Extrapolation, states: list[int], field: str
) -> None:
    truth = np.arange(12.0).reshape(3, 4)
    if field in ("constant", "zero"):
        truth[:] = 5.0 if field == "constant" else 0.0
    if field == "holes":
        truth[1] = NAN
        states = [state for state in states if state not in (4, 5, 6, 7)]
    place = environment(truth)
    fs = captured(place, states, truth)
    prediction = extrapolate(yield_map(fs), place.grid, how)
    wanted = place.grid.valid if states else np.zeros_like(place.grid.valid)
    np.testing.assert_array_equal(np.isfinite(prediction.values), wanted)
    np.testing.assert_array_equal(prediction.values.reshape(-1)[fs.states], truth.reshape(-1)[fs.states])
    np.testing.assert_array_equal(np.isfinite(prediction.deviation), place.grid.valid)
    if states and field in ("constant", "zero"):
        np.testing.assert_array_equal(prediction.values, truth)


@pytest.mark.parametrize("states", [[], [5], [0, 11], [0, 5, 11], list(range(12))])
def test_the_example_evaluates_any_number_of_captured_cells(states: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLE))
    truth = np.arange(12.0).reshape(3, 4)
    evaluation = open_eval(EvalSpec(function="crop_scouting:evaluate")).evaluate(
        captured(environment(truth), states, truth), METRICS
    )
    sys.modules.pop("crop_scouting", None)
    assert evaluation.finished
    assert evaluation.metrics["coverage"] == pytest.approx(len(states) / 12)
    assert 0.0 <= evaluation.metrics["accuracy"] <= 1.0
    assert ("mae" in evaluation.metrics) == bool(states)
    assert sorted(evaluation.artefacts) == ["class", "error", "predicted"]
    if len(states) == 12:
        assert (evaluation.metrics["accuracy"], evaluation.metrics["mae"]) == (1.0, 0.0)


def test_the_example_maps_a_real_field_well_from_a_quarter_of_it(shared_data: Path) -> None:
    place = corn(shared_data, "2018-09-16")
    sample = group_walks(place.grid, 0.25, np.random.default_rng(0))
    assert place.truth is not None
    found = truth_metrics(likely(np.where(sample, place.truth, NAN), place), place)
    assert found["accuracy"] > 0.78

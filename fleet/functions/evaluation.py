"""Built-in parts of Eval() for maps of a field: yield map, error, accuracy, coverage, energy and time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Environment
from fleet.functions.classes import class_mean, classes
from fleet.functions.contract import FeatureSpace, Metrics

Values = NDArray[np.float64]


def yield_map(fs: FeatureSpace, feature: str = "exg", gain: float = 1.0, offset: float = 0.0) -> Values:
    """Expected yield where something was captured: gain x feature + offset, the line that a field is calibrated by.

    Returns:
        float64 [rows, columns], NaN where nothing was captured; in the feature's unit unless gain and offset are given.
    """
    return gain * fs.grid_of(feature) + offset


def error_map(predicted: Values, environment: Environment) -> Values:
    """Predicted minus true value, [rows, columns]; NaN where either is not known."""
    if environment.truth is None:
        return np.full(predicted.shape, np.nan)
    return np.where(environment.grid.valid, predicted - environment.truth, np.nan)


def truth_metrics(predicted: Values, environment: Environment) -> dict[str, float]:
    """How good a predicted map is, in replay, where the truth is known.

    Returns:
        `accuracy`: share of the cells with a true value, captured ones too, whose class is right, 0..1; a cell without
        a prediction is wrong. `mae`: mean absolute error where something is predicted; left out when nothing is.
        Nothing at all when the truth is not known.
    """
    if environment.truth is None:
        return {}
    true = np.isfinite(environment.truth) & environment.grid.valid
    if not true.any():
        return {}
    mean = class_mean(predicted, environment)
    right = classes(predicted, mean)[true] == classes(environment.truth, mean)[true]
    errors = np.abs(error_map(predicted, environment)[true])
    metrics = {"accuracy": float(np.mean(right))}
    if np.isfinite(errors).any():
        metrics["mae"] = float(np.nanmean(errors))
    return metrics


def coverage(fs: FeatureSpace) -> dict[str, float]:
    """`coverage`: share of the cells with data that were captured, 0..1."""
    valid = fs.environment.grid.valid.reshape(-1)
    return {"coverage": float(np.count_nonzero(valid[np.unique(fs.states)])) / max(1, int(np.count_nonzero(valid)))}


def cost_metrics(metrics: Metrics) -> dict[str, float]:
    """`time_s` of the slowest agent; `uav_energy_j`, `edge_energy_j` and their sum `energy_j` over all agents."""
    return {
        "time_s": metrics.time_s,
        "uav_energy_j": metrics.uav_energy_j,
        "edge_energy_j": metrics.edge_energy_j,
        "energy_j": metrics.uav_energy_j + metrics.edge_energy_j,
    }


def evaluation_metrics(predicted: Values, fs: FeatureSpace, metrics: Metrics) -> dict[str, float]:
    """All built-in metrics: `truth_metrics`, `coverage` and `cost_metrics`."""
    return {**truth_metrics(predicted, fs.environment), **coverage(fs), **cost_metrics(metrics)}

"""Classes of a yield map: which cells are poor, fair, good or above the field's mean."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from fleet.contexts.base import Environment
from fleet.functions.kriging import Prediction

Values = NDArray[np.float64]

CLASS_THRESHOLDS = (0.8, 0.9, 1.0)
"""A class is the number of these shares of the field's mean that a value exceeds."""


def class_mean(predicted: Values, environment: Environment) -> float:
    """Mean that the classes refer to: of the truth when it is known, else of the predicted map; 0 without any value."""
    known = predicted if environment.truth is None else environment.truth
    found = known[np.isfinite(known) & environment.grid.valid]
    return float(found.mean()) if len(found) else 0.0


def classes(values: Values, mean: float) -> Values:
    """Class of each cell: how many of 0.8, 0.9 and 1 times the mean it exceeds, 0..3; NaN where the value is NaN."""
    exceeded = np.zeros(values.shape)
    for threshold in CLASS_THRESHOLDS:
        exceeded += values > threshold * mean
    return np.where(np.isnan(values), np.nan, exceeded)


def class_probabilities(prediction: Prediction, mean: float) -> Values:
    """Probability of each class in each cell when errors are normal, float64 [4, rows, columns]; NaN without data."""
    bounds = _bounds(mean)[1:-1, None, None]
    with np.errstate(divide="ignore", invalid="ignore"):  # a deviation of 0 puts all probability on one side
        below = ndtr((bounds - prediction.values) / prediction.deviation)
    sure = prediction.deviation == 0.0
    below = np.where(sure, prediction.values <= bounds, below)
    below = np.where(np.isnan(prediction.values), np.nan, below)
    none, every = np.zeros_like(below[:1]), np.ones_like(below[:1])
    return np.diff(np.concatenate((none, below, every)), axis=0)


def likely_values(prediction: Prediction, mean: float) -> Values:
    """For each cell the value nearest to the predicted one that is in the cell's most probable class.

    An expected value near the field's mean falls into the narrow classes 1 and 2, although the wide classes 0 and 3 are
    more probable when it is uncertain: the map of expected values is not the map with most classes right.

    Returns:
        float64 [rows, columns]; the predicted value where the deviation is 0, NaN without data.
    """
    probable = np.nan_to_num(class_probabilities(prediction, mean)).argmax(axis=0)
    bounds = _bounds(mean)
    lowest = np.nextafter(bounds, np.inf)  # a class begins above its bound
    return np.where(
        prediction.deviation > 0.0,
        np.clip(prediction.values, lowest[probable], bounds[probable + 1]),
        prediction.values,
    )


def expected_accuracy(prediction: Prediction, mean: float) -> dict[str, float]:
    """`expected_accuracy`: what share of the cells has the right class by the prediction's own account, 0..1.

    It needs no truth, so it can end a mission; on real fields it is off by some points (docs/functions.md). Left out
    when nothing is predicted.
    """
    best = class_probabilities(prediction, mean).max(axis=0)
    known = np.isfinite(best)
    return {"expected_accuracy": float(best[known].mean())} if known.any() else {}


def _bounds(mean: float) -> Values:
    """Lower and upper bounds of the classes, ascending, [5]; the mean may be negative."""
    return np.array([-np.inf, *sorted(threshold * mean for threshold in CLASS_THRESHOLDS), np.inf])

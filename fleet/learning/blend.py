"""The scores of several models as one, by an agent's weights.

Source: paper, section "Bayesian optimization for system-level hyperparameters".
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fleet.errors import ModelError

DECIMALS = 9
"""Scores are rounded: sums that differ in the last bits, because a model ran on another machine, choose alike."""


def blend(scores: Mapping[str, NDArray[np.float64]], weights: Mapping[str, float]) -> NDArray[np.float64]:
    """The weighted sum of the models' scores; a model without a weight, or of weight 0, does not count.

    Args:
        scores: Scores of each model by its key, float64 [..., len(MOVES)], all of one shape.
        weights: Weight of each model key.
    Returns:
        Scores of that shape, summed in the order of the sorted keys, rounded to 9 decimals.
    Raises:
        ModelError: a model that has a weight gives no scores, or no model has a weight.
    """
    counting = sorted(key for key, weight in weights.items() if weight != 0.0)
    missing = [key for key in counting if key not in scores]
    if missing or not counting:
        raise ModelError(
            f"no scores of {', '.join(missing)} to blend; there are {', '.join(sorted(scores)) or 'none'}"
            if missing
            else "no model has a weight; give at least one a weight above 0"
        )
    total = scores[counting[0]] * weights[counting[0]]
    for key in counting[1:]:
        total = total + scores[key] * weights[key]
    return np.asarray(np.round(total, DECIMALS))

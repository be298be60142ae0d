"""What a capture is worth: the shaped reward over what the swarm believes.

R of the paper is a weighted sum of the features of the next state. Here these features are the platform's own, from
the belief of the map before the capture.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve, distance_transform_edt

from fleet.functions.belief import Belief
from fleet.planning.tactics import InterestWeights

Values = NDArray[np.float64]
Flags = NDArray[np.bool_]

FEW = 12
"""Before so many captures classes mean nothing, and every cell is equally interesting."""
REACH = 3
"""Rows and columns to the cells that count as around."""
FAR = 3.0
_FALL = 1.5


def doubts(belief: Belief) -> Values:
    """Probability that the believed class is wrong, float64 [rows, columns]; 0 in captured cells and without data."""
    doubt: Values = 1.0 - np.nan_to_num(belief.class_probabilities().max(axis=0), nan=1.0)
    return np.where(belief.known, 0.0, doubt)


def features(belief: Belief) -> Values:
    """Doubt, doubt around and novelty of every cell, float64 [3, rows, columns]; see `InterestWeights`."""
    doubt = doubts(belief)
    around = convolve(doubt, AROUND, mode="constant")
    height, width = belief.grid.cell_height_m, belief.grid.cell_width_m
    size = (height * width) ** 0.5
    distance = distance_transform_edt(~belief.known, sampling=(height / size, width / size))
    return np.stack((doubt, around, 1.0 - np.exp(-distance / FAR)))


def interest(belief: Belief, weights: InterestWeights) -> Values:
    """What each capture adds, float64 [rows, columns]; 0 in captured cells and without data.

    The whole field at once; `fleet.planning.outlook` is the fast form for a part of it.
    """
    free = belief.free
    if belief.captured < FEW:
        return np.where(free, 0.5, 0.0)
    doubt, around, novelty = features(belief)
    total = weights.doubt * doubt + weights.doubt_around * around + weights.novelty * novelty
    return np.where(free, total, 0.0)


def _around() -> Values:
    """Shares of the cells around in the doubt around a cell, [7, 7]; their sum is 1."""
    side = np.arange(-REACH, REACH + 1)
    share = np.exp(-np.hypot(side[:, None], side[None, :]) / _FALL)
    share[REACH, REACH] = 0.0
    return np.asarray(share / share.sum())


AROUND: Values = _around()
"""Share of each cell around in the doubt around a cell, float64 [7, 7]; 0 in the middle."""

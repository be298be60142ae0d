"""Small made-up fields to plan over, and what flying costs there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Environment
from fleet.contexts.grid import Grid
from fleet.energy.accounting import EnergyModel
from fleet.energy.profiles import load_aircraft, load_edge
from fleet.functions.belief import Belief
from fleet.functions.classes import class_probabilities
from fleet.functions.kriging import Variogram, matern32

Values = NDArray[np.float64]
ENERGY = EnergyModel(load_aircraft("spark-survey"), load_edge("laptop-i5"))
SMOOTH = Variogram(30.0, 0.1, 225.0)
CELL_M = 10.0


def full(rows: int, columns: int) -> Grid:
    """A field with data everywhere."""
    return Grid(np.ones((rows, columns), dtype=np.bool_), CELL_M, CELL_M)


def drawn(seed: int, rows: int = 12, columns: int = 14) -> Values:
    """A field drawn from the Gaussian process SMOOTH, about 100, float64 [rows, columns]."""
    row, column = (axis.reshape(-1) * CELL_M for axis in np.mgrid[:rows, :columns])
    apart = np.hypot(row[:, None] - row[None, :], column[:, None] - column[None, :])
    alike = (1.0 - SMOOTH.nugget) * matern32(apart / SMOOTH.length) + SMOOTH.nugget * np.eye(len(row))
    white = np.random.default_rng(seed).normal(size=len(row))
    return 100.0 + (np.linalg.cholesky(SMOOTH.variance * alike) @ white).reshape(rows, columns)


def environment(truth: Values) -> Environment:
    """A field that is known; no data where the truth is NaN."""
    return Environment("field", "", Grid(np.isfinite(truth), CELL_M, CELL_M), "exg", truth)


def probabilities_of(belief: Belief, cell: int) -> Values:
    """Probability of each class of one cell, from the map of the belief, float64 [4]."""
    return class_probabilities(belief.prediction(), belief.class_mean).reshape(4, -1)[:, cell]

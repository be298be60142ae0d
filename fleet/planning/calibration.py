"""How far to trust what kriging believes: its own predictions, held against what was then captured.

Before a cell is captured the belief names its most probable class and how probable that is; the capture tells whether
it was right. From these pairs the probabilities are calibrated in flight by logistic regression on their logits (Platt
scaling), with a prior that says they are right as they are and fades as captures come in. Agents choose cells by these
very probabilities, so what is captured says something about what is not, as long as it is asked by probability.

Source: Platt 1999, Probabilistic Outputs for Support Vector Machines; Dawid 1984, the prequential approach, JRSS A 147.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fleet.functions.belief import Belief, class_bounds
from fleet.functions.kriging_kernel import class_probabilities
from fleet.planning.interest import FEW
from fleet.planning.outlook_kernel import sureness

Values = NDArray[np.float64]
REMEMBERED = 400
"""Captures that count: the belief gets better, and what it got wrong long ago says little of it."""
PRIOR = np.array([0.0, 1.0])
"""Offset and slope that leave a probability as it is."""
PRECISION = np.array([20.0, 100.0])
"""How many captures the prior weighs as much as, about."""
_ASKED_OF = 200
_LEAST, _MOST = 0.02, 0.99
_ITERATIONS = 12


class _Map(NamedTuple):
    """Mean and deviation of cells, as in a belief, float64 [cells]."""

    mean: Values
    deviation: Values


@dataclass(frozen=True, eq=False)
class _Foreseen:
    """What was believed of all cells, what the classes referred to, and how many cells were captured."""

    map: _Map
    class_mean: float
    captured: int

    @staticmethod
    def by(belief: Belief) -> _Foreseen:
        return _Foreseen(
            _Map(belief.state.mean.copy(), belief.state.deviation.copy()), belief.class_mean, belief.captured
        )

    def probabilities(self, cell: int) -> Values:
        """Of the classes of one cell, float64 [4]."""
        bounds = class_bounds(self.class_mean)
        found = np.empty((len(bounds) + 1, 1))
        here = _Map(self.map.mean[cell : cell + 1], self.map.deviation[cell : cell + 1])
        class_probabilities(here, bounds, found)
        return found[:, 0]


@dataclass(eq=False)
class Calibration:
    """What became of predictions.

    The next captures lie beside the last ones, where it is easy to be right. So the belief is asked now and then about
    all cells at once, and what is captured before it is asked again is held against that.

    Args:
        lag: Captures before it is asked again; when 200 times as many are captured, more, in proportion: asking takes
            as long as there are cells.
        pairs: Probability of the believed class, and whether it was right, for each capture that counts.
        count: How many predictions were held against captures.
    """

    lag: int = 16
    pairs: deque[tuple[float, bool]] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    count: int = 0
    _foreseen: _Foreseen | None = None

    def foresee(self, belief: Belief, cell: int, value: float) -> None:
        """Hold the belief in a cell against the value that is captured there; before the belief takes it in."""
        if belief.captured < FEW:
            return
        lag = max(self.lag, belief.captured // _ASKED_OF)
        if self._foreseen is None or belief.captured >= self._foreseen.captured + lag:
            self._foreseen = _Foreseen.by(belief)
        probabilities = self._foreseen.probabilities(cell)
        believed = int(np.argmax(probabilities))
        found = int(np.count_nonzero(value > class_bounds(self._foreseen.class_mean)))
        self.pairs.append((float(probabilities[believed]), believed == found))
        self.count += 1

    def fitted(self) -> Values:
        """Offset and slope of the logit, float64 [2]: the most probable ones after these pairs."""
        if not self.pairs:
            return PRIOR
        said, right = (np.array(column, dtype=np.float64) for column in zip(*self.pairs, strict=True))
        return fit(said, right)

    def calibrated(self, probabilities: Values) -> Values:
        """How often a class is right that the belief gives these probabilities."""
        offset, slope = self.fitted()
        return np.asarray(1.0 / (1.0 + np.exp(-(offset + slope * _logit(probabilities)))))


def fit(said: Values, right: Values) -> Values:
    """Offset and slope by Newton's method on the log posterior, which is concave.

    Args:
        said: Probabilities, float64 [n].
        right: 1 where the prediction was right, else 0, float64 [n].
    """
    design = np.stack((np.ones_like(said), _logit(said)), axis=1)
    found = PRIOR
    for _ in range(_ITERATIONS):
        chance = 1.0 / (1.0 + np.exp(-design @ found))
        slope = design.T @ (right - chance) - PRECISION * (found - PRIOR)
        curvature = (design * (chance * (1.0 - chance))[:, None]).T @ design + np.diag(PRECISION)
        step = np.linalg.solve(curvature, slope)
        found = found + step
        if float(np.abs(step).max()) < 1e-9:
            break
    return np.asarray(found)


def expected_accuracy(belief: Belief, calibration: Calibration) -> float:
    """Share of the cells whose class is right on the map as it is now, as far as is known: captured cells are.

    Of a field of more than 4,096 cells some stand for all (`Belief.sample`); where none of these is free any more, what
    is left, less than a thousandth, counts as wrong.
    """
    if belief.captured < min(FEW, belief.cells):
        return 0.0
    probable = np.empty(len(belief.sample))
    count = sureness(belief.state, class_bounds(belief.class_mean), belief.sample, probable)
    share = float(calibration.calibrated(probable[:count]).mean()) if count else 0.0
    return (belief.captured + (belief.cells - belief.captured) * share) / belief.cells


def _logit(probabilities: Values) -> Values:
    bounded = np.clip(probabilities, _LEAST, _MOST)
    return np.asarray(np.log(bounded / (1.0 - bounded)))

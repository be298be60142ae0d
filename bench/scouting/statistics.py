"""Is a difference more than chance: paired differences with bootstrap intervals.

Both plans fly the same field with the same seed, so what a seed makes easy or hard falls out of their difference. A
figure over several fields is the mean over the fields for each seed; seeds are what is drawn anew.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap

LEVEL = 0.95
RESAMPLES = 9_999
Values = NDArray[np.float64]


@dataclass(frozen=True)
class Interval:
    """A mean, and where it lies with 95 % confidence.

    Args:
        mean, low, high: In the unit of the values.
        pairs: How many differences it is made from.
    """

    mean: float
    low: float
    high: float
    pairs: int

    @property
    def certain(self) -> bool:
        """Whether 0 is outside."""
        return self.low > 0.0 or self.high < 0.0


def paired(ours: Values, theirs: Values, seed: int = 0) -> Interval:
    """Mean of ours minus theirs, with its BCa bootstrap interval (Efron 1987).

    Args:
        ours, theirs: Figures of the same seeds, float64 [seeds]; a pair with a NaN is left out.
        seed: Of the bootstrap's draws.
    Raises:
        ValueError: there are not equally many.
    """
    if ours.shape != theirs.shape:
        raise ValueError(f"{len(ours)} figures cannot be paired with {len(theirs)}")
    differences = ours - theirs
    return interval(differences[np.isfinite(differences)], seed)


def interval(values: Values, seed: int = 0) -> Interval:
    """Mean of some values with its interval; of one value, or of equal ones, the interval is the mean itself."""
    if not len(values):
        return Interval(float("nan"), float("nan"), float("nan"), 0)
    mean = float(values.mean())
    if np.ptp(values) <= 1e-12 * max(1.0, abs(mean)):
        return Interval(mean, mean, mean, len(values))
    found = bootstrap(
        (values,),
        np.mean,
        confidence_level=LEVEL,
        n_resamples=RESAMPLES,
        method="BCa",
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return Interval(mean, float(found.low), float(found.high), len(values))

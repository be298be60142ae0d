"""What captures brought, in flights over fields whose truth is known: interest weights are learned from that.

A capture's gain is the number of cells whose most probable class became right by it. One gain is mostly chance (its
mean is 0.7 cells, its deviation 6 to 12), so many flights are needed. Captures at which the covariance was fitted anew
are left out: what changed then is not theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from bench.scouting.campaign import known
from bench.scouting.informed import Mission, scouted
from fleet.functions.classes import class_mean, classes, likely_values
from fleet.functions.kriging import Variogram
from fleet.planning.interest import FEW, interest
from fleet.planning.swarm import Swarm
from fleet.planning.tactics import InterestWeights, Tactics

Values = NDArray[np.float64]
FEATURES = tuple(InterestWeights.model_fields)
ALONE = tuple(InterestWeights(**{each: float(each == name) for each in FEATURES}) for name in FEATURES)
"""Interest that is one feature."""
FLOWN = (Tactics(), Tactics(weights=InterestWeights(doubt=0.05, doubt_around=0.0, novelty=1.0)))
"""Flights that are learned from: by what is believed to be good, and by another thing, so that features vary."""
_MOST = 6.0
"""Gains beyond this are cut: a class bound that moves by a little turns many cells at once."""


@dataclass(frozen=True, eq=False)
class Gains:
    """What captures brought.

    Args:
        features: FEATURES of each captured cell before the capture, float64 [n, features].
        gain: Cells that became right, less those that became wrong, float64 [n].
    """

    features: Values
    gain: Values


def gains(mission: Mission) -> Gains:
    """The gains of one mission over a known field."""
    place = known(mission.field, 0)
    environment, valid = place.environment, place.grid.valid
    whole = place.truth.reshape(valid.shape)
    mean = class_mean(whole, environment)
    truth = classes(whole, mean)
    features: list[list[float]] = []
    right: list[int] = []
    variograms: list[Variogram] = []

    def before(swarm: Swarm, cell: int) -> None:
        if swarm.belief.captured >= FEW:
            features.append([float(interest(swarm.belief, weights).flat[cell]) for weights in ALONE])
            found = classes(likely_values(swarm.belief.prediction(), mean), mean)
            right.append(int((found == truth)[valid].sum()))
            variograms.append(swarm.belief.variogram)

    scouted(mission, before)
    same = np.array([one == after for one, after in pairwise(variograms)], dtype=np.bool_)
    return Gains(np.array(features)[:-1][same], np.diff(right)[same].astype(np.float64))


def missions(names: Sequence[str], agents: int, seeds: Sequence[int]) -> list[Mission]:
    """All flights over some fields that are learned from."""
    first = [Mission(name, agents, seed) for name in names for seed in seeds]
    return [replace(mission, tactics=tactics) for tactics in FLOWN for mission in first]


def learned(found: Sequence[Gains]) -> InterestWeights:
    """Coefficients of the gains on the features by least squares, none below 0.

    Their scale is without meaning: what energy is worth is a share of the interest that there is.

    Raises:
        ValueError: no feature says anything.
    """
    features = np.concatenate([each.features for each in found])
    gain = np.clip(np.concatenate([each.gain for each in found]), -_MOST, _MOST)
    weights, _ = nnls(features, gain)
    if not weights.any():
        raise ValueError("nothing that is known before a capture says what it brings")
    return InterestWeights(**dict(zip(FEATURES, (weights / weights.max()).tolist(), strict=True)))

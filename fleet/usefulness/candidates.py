"""Points on the simplex of weights: where to look for better weights, and what to replay."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fleet.randomness import named_seed

LARGEST_STEP = 0.5
"""How far from the best known weights new ones may lie: at most half of the weight moves in one mission."""
CONCENTRATIONS = (0.1, 0.3, 1.0, 3.0)
"""Of the Dirichlet distributions: from nearly single models to nearly uniform."""
SAMPLES = 64
"""Of each concentration."""


def directions(models: int, seed: int) -> NDArray[np.float64]:
    """Where new weights may lead to: single models, all alike, and random mixtures; float64 [n, models]."""
    generator = np.random.default_rng(named_seed(seed, "directions"))
    mixtures = [generator.dirichlet(np.full(models, each), size=SAMPLES) for each in CONCENTRATIONS]
    return np.concatenate([np.eye(models), np.full((1, models), 1.0 / models), *mixtures])


def around(best: NDArray[np.float64], towards: NDArray[np.float64], *steps: float) -> NDArray[np.float64]:
    """Points on the way from the best weights to others, float64 [steps * n, models]; a step of 1 goes all the way."""
    return np.concatenate([best + step * (towards - best) for step in steps])


def replayed(best: NDArray[np.float64], last: NDArray[np.float64], count: int, seed: int) -> NDArray[np.float64]:
    """What to replay: the last weights, the best, then the way to each single model, then to random mixtures.

    When there are more models than replays, the models take turns by chance.
    Returns:
        Different points, float64 [at most count, models].
    """
    generator = np.random.default_rng(named_seed(seed, "replays"))
    models = len(best)
    singles = np.eye(models)[generator.permutation(models)]
    mixtures = generator.dirichlet(np.ones(models), size=count)
    towards = np.concatenate([singles, mixtures])
    points = np.concatenate([last[None], best[None], around(best, towards, LARGEST_STEP)])
    first = np.sort(np.unique(np.round(points, 9), axis=0, return_index=True)[1])
    return np.asarray(points[first[:count]])

"""Weights over the models from what each model alone would lose: exponential weights, and the best single model.

Each model is an expert. What it would have lost in the last mission is replayed with the mission's own records; the
replay starts from the mission's own loss, so what is wrong in the records' belief counts only where models differ.

Source: Freund, Schapire: A decision-theoretic generalization of on-line learning, 1997 (Hedge); Cesa-Bianchi, Mansour,
Stoltz: Improved second-order bounds for prediction with expert advice, 2007 (its rate by the variance of the losses);
Cesa-Bianchi, Gaillard, Lugosi, Stoltz: Mirror descent meets fixed share, 2012 (fields drift: a share is kept for all).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

HORIZON = 2
"""T, missions for which the best model is taken to stay the best: a field of weeks ago says little of today's."""
SHARED = 0.02
"""Share of the weight that is spread over all models after each mission."""
POOLED = 0.5
"""How far what an agent's own replays say is drawn to the mean over all agents, which is steadier."""

_EQUAL = 1e-9
"""Losses that differ by no more are equal."""


def pooled(losses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Losses of the models by agent, float64 [agents, models], each agent's drawn half way to the mean of all."""
    return np.asarray((1.0 - POOLED) * losses + POOLED * losses.mean(axis=0))


def exponential_weights(last: NDArray[np.float64], losses: NDArray[np.float64]) -> NDArray[np.float64]:
    """The next weights of an agent: less for what lost more, and a share for every model.

    w_i <- v_i exp(-eta l_i) / Z with v = (1 - s) w + s / K, s = `SHARED`, K models, and eta = sqrt(ln K / (T V)),
    V the variance of the losses under v: over T missions the regret to the best model grows as sqrt(T V ln K). When all
    losses are equal, models that had no weight get the share of one among K.

    Args:
        last: Weights of the last mission, float64 [models], sum 1.
        losses: Of each model alone, float64 [models].
    Returns:
        Weights, float64 [models]; sum 1.
    """
    count = len(last)
    started = (1.0 - SHARED) * last + SHARED / count
    variance = float(started @ (losses - started @ losses) ** 2)
    if variance < _EQUAL**2:
        return _entered(last)
    rate = math.sqrt(math.log(count) / (HORIZON * variance))
    grown = started * np.exp(-rate * (losses - losses.min()))
    return np.asarray(grown / grown.sum())


def _entered(last: NDArray[np.float64]) -> NDArray[np.float64]:
    """Nothing tells the models apart: those without a weight get as much as each would have if all were alike."""
    new = last <= 0.0
    share = float(new.mean())
    return np.where(new, 1.0 / len(last), last * (1.0 - share))


def best_alone(last: NDArray[np.float64], losses: NDArray[np.float64]) -> NDArray[np.float64]:
    """All weight on the model that loses least; of equals on the one that had most.

    Args:
        last: Weights of the last mission, float64 [models].
        losses: Of each model alone, float64 [models].
    """
    equals = np.flatnonzero(losses <= losses.min() + _EQUAL)
    chosen = np.zeros(len(last))
    chosen[equals[int(np.argmax(last[equals]))]] = 1.0
    return chosen

"""Weights over the models, by agent: learned from what was flown, and from replays of the last mission.

With expected improvement each agent has its own process over its own weights. It is told one observation a mission, and
replays of the last mission as more and noisier ones. With 16 models and a few missions the process knows little, and
expected improvement alone would try one corner of the simplex after the other. So the next weights lie at most
`LARGEST_STEP` of the way from the best that was flown; while only one point is known, they move a little towards all
models alike. Replays help it or do no harm (`python -m bench.replays`); without them it is no better than keeping the
first weights. The other learners look at each model alone (`usefulness.experts`), by replays; without them weights
stay.

Source: paper, section "Bayesian optimization for system-level hyperparameters".
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fleet.missions.documents import INITIAL
from fleet.randomness import named_seed
from fleet.spec.learning import OnlineLearning, WeightLearner
from fleet.usefulness.candidates import LARGEST_STEP, around, directions, replayed
from fleet.usefulness.experts import best_alone, exponential_weights, pooled
from fleet.usefulness.history import History, Observation, Weights

Replay = Callable[[str, Sequence[Weights]], Sequence[float]]
"""From an agent and weights to the loss that the agent would have with each of them."""

MISSION_NOISE_SD = 0.005
"""Standard deviation of a mission's loss for the same weights, in units of the loss; 0.02 and 0.002 were not better."""
FIRST_STEP = LARGEST_STEP / 2
"""How far the weights move towards all models alike while only one point is known."""
DECIMALS = 6


def first_weights(agents: Sequence[str]) -> dict[str, dict[str, float]]:
    """Weights before the first mission: every agent flies with the model of the first training alone."""
    return {agent: {INITIAL: 1.0} for agent in agents}


def propose_weights(
    history: History,
    models: Sequence[str],
    agents: Sequence[str],
    learning: OnlineLearning,
    seed: int,
    replay: Replay | None = None,
) -> dict[str, dict[str, float]]:
    """Weights for the next mission.

    Args:
        history: What was flown, and what came of it.
        models: Keys of the models that the next mission flies with.
        agents: Names of the agents.
        seed: Fixes the candidates.
        replay: Replays the last mission with other weights; None when it cannot be replayed.
    Returns:
        By agent the weight of each of the models; each agent's sum up to 1.
    """
    keys = sorted(models)
    match learning.weights:
        case WeightLearner.UNIFORM:
            points = [np.full(len(keys), 1.0 / len(keys)) for _ in agents]
        case WeightLearner.EXPECTED_IMPROVEMENT:
            points = [
                _improve(history.of(agent), keys, learning, named_seed(seed, f"weights/{agent}"), _of(agent, replay))
                for agent in agents
            ]
        case WeightLearner.MULTIPLICATIVE_WEIGHTS:
            points = _by_losses(exponential_weights, history, agents, keys, replay if learning.replays else None)
        case WeightLearner.BEST_BY_REPLAY:
            points = _by_losses(best_alone, history, agents, keys, replay if learning.replays else None)
    return {agent: _weights_at(point, keys) for agent, point in zip(agents, points, strict=True)}


def usefulness(
    weights: Mapping[str, Weights], models: Collection[str], flown: Collection[str] = ()
) -> dict[str, float | None]:
    """How useful each model is: the mean of the weights that the agents give it.

    Args:
        weights: By agent.
        models: Keys of all models.
        flown: Models that had a weight in an earlier mission.
    Returns:
        None for a model that has no weight now and never had one: nothing is known of it.
    Source: paper, section "Priority-based Scheduling", U_i.
    """
    means = {model: sum(own.get(model, 0.0) for own in weights.values()) / len(weights) for model in models}
    return {model: mean if mean > 0 or model in flown else None for model, mean in sorted(means.items())}


def _of(agent: str, replay: Replay | None) -> Callable[[Sequence[Weights]], Sequence[float]] | None:
    return None if replay is None else lambda weights: replay(agent, weights)


def _improve(
    flown: Sequence[Observation],
    keys: Sequence[str],
    learning: OnlineLearning,
    seed: int,
    replay: Callable[[Sequence[Weights]], Sequence[float]] | None,
) -> NDArray[np.float64]:
    """The next point on the simplex of one agent."""
    if not flown:
        return _point({INITIAL: 1.0}, keys)
    points = np.array([_point(each.weights, keys) for each in flown])
    losses = np.array([each.loss for each in flown])
    noise_sd = np.full(len(flown), MISSION_NOISE_SD)
    best = points[len(losses) - 1 - int(np.argmin(losses[::-1]))]  # the latest of equals
    if replay is not None and learning.replays:
        tried = replayed(best, points[-1], learning.replays, seed)
        believed = np.asarray(replay([_weights_at(point, keys) for point in tried]))
        points = np.concatenate([points, tried])
        losses = np.concatenate([losses, believed])
        noise_sd = np.concatenate([noise_sd, np.full(len(tried), MISSION_NOISE_SD * learning.replay_noise)])
    if len(np.unique(points, axis=0)) < 2:
        return np.asarray(around(best, np.full((1, len(keys)), 1.0 / len(keys)), FIRST_STEP)[0])
    candidates = np.concatenate(
        [best[None], around(best, directions(len(keys), seed), LARGEST_STEP, LARGEST_STEP / 2), points[len(flown) :]]
    )
    from fleet.learning.bayes import (  # noqa: PLC0415 - who only reads weights, as the operator, needs no scipy
        expected_improvement,
    )

    gain = expected_improvement(points, losses, noise_sd, candidates, seed)
    return np.asarray(candidates[int(np.argmax(gain))])


def _by_losses(
    rule: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]],
    history: History,
    agents: Sequence[str],
    keys: Sequence[str],
    replay: Replay | None,
) -> list[NDArray[np.float64]]:
    """The next point of each agent, by a rule from its last one and from what each model alone would lose.

    Without replays nobody knows what a model alone would lose, and weights stay. To learn it from missions would take
    flights with each model, and most of them are worse than what they would teach.
    """
    lasts = [_last(history.of(agent), keys) for agent in agents]
    if replay is None or not history.observations:
        return lasts
    alone = [_weights_at(point, keys) for point in np.eye(len(keys))]
    losses = np.array([replay(agent, alone) for agent in agents], dtype=np.float64)
    return [rule(last, loss) for last, loss in zip(lasts, pooled(losses), strict=True)]


def _last(flown: Sequence[Observation], keys: Sequence[str]) -> NDArray[np.float64]:
    """What an agent flew with last, on the simplex of today's models."""
    return _point(flown[-1].weights if flown else {INITIAL: 1.0}, keys)


def _point(weights: Weights, keys: Sequence[str]) -> NDArray[np.float64]:
    """Weights as a point on the simplex of today's models; what was given to models that are gone is shared out."""
    point = np.array([weights.get(key, 0.0) for key in keys])
    if point.sum() <= 0:
        point = np.array([float(key == INITIAL) for key in keys])
    if point.sum() <= 0:
        point = np.ones(len(keys))
    return np.asarray(point / point.sum())


def _weights_at(point: NDArray[np.float64], keys: Sequence[str]) -> dict[str, float]:
    """A point as weights that are short to write and sum up to 1."""
    rounded = np.round(point, DECIMALS)
    rounded[int(np.argmax(rounded))] += 1.0 - rounded.sum()
    return {key: round(float(weight), DECIMALS) for key, weight in zip(keys, rounded, strict=True)}

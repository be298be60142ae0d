"""SA as a table: SSVs never change within a context, so a policy is its score of each move in each state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.learning.blend import blend
from fleet.learning.model import SAModel
from fleet.learning.reward import RewardModel
from fleet.missions.documents import INITIAL
from fleet.missions.layout import MOVES
from fleet.simulator.batch import Batch
from fleet.simulator.terrain import Terrain

ALONE = {INITIAL: 1.0}
"""Weights of a policy of one model."""
NEVER = (1e300, 2**31 - 1)
"""Thresholds that are never passed: every state is visited."""


def score_table(models: Mapping[str, SAModel], weights: Mapping[str, float], terrain: Terrain) -> NDArray[np.float64]:
    """Blended scores of each state, float64 [cells, len(MOVES)]; 0 in states without data.

    Args:
        models: Models by key; those without a weight are not asked.
        weights: Weight of each model key.
        terrain: The mapped context.
    Raises:
        ModelError: a model is for another SSV, or has a weight and is not there.
    """
    mapped = np.isfinite(terrain.ssv).all(axis=1)
    asked = {key: models[key].scores(terrain.ssv[mapped]) for key in weights if weights[key] != 0.0 and key in models}
    table = np.zeros((len(terrain.ssv), len(MOVES)))
    table[mapped] = blend(asked, weights)
    return table


def reward_table(reward: RewardModel, terrain: Terrain) -> NDArray[np.float64]:
    """Reward of a transition into each state, float64 [cells]; 0 in states without data."""
    return np.nan_to_num(reward.reward(terrain.ssv), nan=0.0)


@dataclass(frozen=True)
class Flights:
    """Missions that differ in their random draws alone.

    Args:
        first: Number of the first mission.
        count: How many.
        exploration: Share of random choices.
        seed: With a mission's number it fixes all random choices.
    """

    first: int = 0
    count: int = 1
    exploration: float = 0.0
    seed: int = 0


def batch_of(table: NDArray[np.float64], reward: RewardModel, terrain: Terrain, flights: Flights) -> Batch:
    """Missions over one terrain in which every agent flies with one score table [cells, len(MOVES)]."""
    count = flights.count
    return Batch(
        scores=table[None],
        table=np.zeros((count, terrain.layout.agents), dtype=np.int64),
        rewards=reward_table(reward, terrain)[None],
        reward_of=np.zeros(count, dtype=np.int64),
        utility_thresholds=np.full(count, reward.utility_threshold),
        visited_thresholds=np.full(count, reward.visited_threshold, dtype=np.int64),
        exploration=np.full(count, flights.exploration),
        missions=np.arange(flights.first, flights.first + count, dtype=np.int64),
        seed=flights.seed,
    )

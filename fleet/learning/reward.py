"""R(s, a, s'): the weighted sum of the normalised features of the next state, and the shaped values around it.

Source: paper, section "Reward Shaping and Training".
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from fleet.errors import TrainingError
from fleet.planning.stop import StopRule
from fleet.planning.tactics import InterestWeights
from fleet.spec.base import Model


class Normaliser(Model):
    """Maps each feature to [0, 1] by its least and greatest value over the contexts; values outside are cut off."""

    low: tuple[float, ...]
    high: tuple[float, ...]

    @staticmethod
    def over(samples: Iterable[NDArray[np.float64]]) -> Normaliser:
        """The normaliser of SSV samples, each float64 [n, features]; rows with NaN do not count."""
        rows = np.concatenate([sample[np.isfinite(sample).all(axis=1)] for sample in samples])
        return Normaliser(low=tuple(rows.min(axis=0).tolist()), high=tuple(rows.max(axis=0).tolist()))

    def apply(self, ssv: NDArray[np.float64]) -> NDArray[np.float64]:
        """Normalised SSVs of the same shape; a feature that never varies becomes 0."""
        low, high = np.array(self.low), np.array(self.high)
        span = np.where(high > low, high - low, np.inf)
        return np.asarray(np.clip((ssv - low) / span, 0.0, 1.0))


class PlannerReward(Model):
    """What a Planner flies by: R over what is believed of the next states, and HA as a stop."""

    feature: str = Field(description="The feature of the SSV that is mapped.")
    expects: bool = Field(default=True, description="Whether Eval() makes its map with what is expected of the cells.")
    weights: InterestWeights = Field(description="R: what makes a capture interesting.")
    goal: float = Field(description="Accuracy to reach.")
    caution: float = Field(description="How much the expected accuracy may be off by after one prediction.")

    @property
    def rule(self) -> StopRule:
        """HA."""
        return StopRule(self.goal, self.caution)


class RewardModel(Model):
    """What reward shaping found: feature weights and HA thresholds.

    Stored as JSON; every role that needs rewards reads it.
    """

    features: tuple[str, ...]
    weights: tuple[float, ...] = Field(description="Weight of each feature, in [0, 1].")
    normaliser: Normaliser
    utility_threshold: float = Field(description="T_u")
    visited_threshold: int = Field(description="T_v")
    loss: float = Field(description="Sum of the losses over the shaping contexts.")
    goals_met: bool = Field(description="Whether every goal was met on every shaping context.")
    evaluations: int = Field(default=0, description="Parameter sets that were simulated.")
    successes: int = Field(default=0, description="How many of them met every goal on every shaping context.")
    planner: PlannerReward | None = Field(
        default=None, description="What a Planner flies by; its weights and thresholds above are 0 and have no meaning."
    )

    @property
    def of_planner(self) -> PlannerReward:
        """What a Planner flies by.

        Raises:
            TrainingError: it was shaped for state groups.
        """
        if self.planner is None:
            raise TrainingError("the reward was shaped for state groups, and sa.kind is Planner; train again")
        return self.planner

    @property
    def of_groups(self) -> RewardModel:
        """This reward, for agents that fly through state groups.

        Raises:
            TrainingError: it was shaped for a Planner.
        """
        if self.planner is not None:
            raise TrainingError("the reward was shaped for a Planner, and sa.kind is another; train again")
        return self

    def reward(self, ssv: NDArray[np.float64]) -> NDArray[np.float64]:
        """R of a transition into a state, [n], for SSVs [n, features]; NaN rows stay NaN."""
        terms = self.normaliser.apply(ssv) * np.array(self.weights)
        total = terms[..., 0]
        for feature in range(1, terms.shape[-1]):  # a fixed order of sums: equal for one row and for many
            total = total + terms[..., feature]
        return np.asarray(total)

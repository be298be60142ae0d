"""What is known of the weights that agents flew with: one observation an agent and mission."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

Weights = Mapping[str, float]
"""Weight of each model key; not negative, sums to 1. A model that is left out has weight 0."""


@dataclass(frozen=True)
class Observation:
    """One agent's weights in one mission, and what came of them.

    Args:
        loss: The smaller the better; see `usefulness.loss`.
    """

    mission: int
    agent: str
    weights: Weights
    loss: float


@dataclass(frozen=True)
class History:
    """All missions so far."""

    observations: tuple[Observation, ...] = ()

    def of(self, agent: str) -> tuple[Observation, ...]:
        """One agent's observations in the order of missions."""
        own = (each for each in self.observations if each.agent == agent)
        return tuple(sorted(own, key=lambda each: each.mission))

    @property
    def flown(self) -> frozenset[str]:
        """Models that some agent gave a weight in some mission."""
        return frozenset(key for each in self.observations for key, weight in each.weights.items() if weight > 0)

"""Replays of a mission that agents planned together: what it would have cost with other weights over the models.

All fly the last mission again over what its records say of the field, with the same starts, until their map of that
field is as good as the one with which the last mission's own weights end after as many captures. What counts is the
energy that this takes, over that of the last mission's weights: what is wrong in the belief is wrong in both. Agents
share one map, so what is good for one is good for all: every agent's loss is that of the swarm.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fleet.energy.accounting import EnergyModel
from fleet.functions.classes import classes, likely_values
from fleet.learning.planner import BELIEVED, PlannerModel, blended
from fleet.missions.layout import Layout
from fleet.planning.scouting import Scout
from fleet.planning.swarm import Swarm
from fleet.planning.tactics import InterestWeights, Tactics
from fleet.usefulness.history import Weights
from fleet.usefulness.loss import Effort, MissionLoss

LEVELS = 8
"""Accuracies at which energies are compared, over the second half of the mission: one alone is a matter of luck."""
Values = NDArray[np.float64]


@dataclass(eq=False)
class PlannedReplayer:
    """Flies the last mission again; a `usefulness.weights.Replay`.

    Args:
        layout: Who flew where.
        agents: Names of the agents, in the layout's order.
        values: What is believed of each cell, float64 [cells]; NaN without data.
        captured: How many cells the mission captured.
        flown: Weights of each agent in the last mission.
        before: The models that flew in it.
        after: The models as they fly in the next mission.
        energy: Costs of actions.
        loss: The loss of the last mission.
    """

    layout: Layout
    agents: Sequence[str]
    values: NDArray[np.float64]
    captured: int
    flown: Mapping[str, Weights]
    before: Mapping[str, PlannerModel]
    after: Mapping[str, PlannerModel]
    energy: EnergyModel
    loss: MissionLoss
    _known: dict[tuple[float, ...], float] = field(default_factory=dict, init=False)

    def __call__(self, agent: str, candidates: Sequence[Weights]) -> list[float]:
        """The loss with the next models and these weights; the same for every agent."""
        return [self.loss.of(self._effort(blended(self.after, weights))) for weights in candidates]

    def _effort(self, interest: InterestWeights) -> Effort:
        """That of the last mission, if all agents had flown with these weights."""
        key = tuple(getattr(interest, name) for name in BELIEVED)
        if key not in self._known:
            accuracies, energies_j = self._last
            curve = self._fly([interest] * len(self.agents), lambda flown: flown.accuracy[-1] >= accuracies[-1])
            reached_j = [curve.energy_at(accuracy) for accuracy in accuracies]
            self._known[key] = float(np.mean(np.array(reached_j) / energies_j))
        whole = self.loss.whole
        return Effort(whole.captured, whole.energy * self._known[key])

    @cached_property
    def _last(self) -> tuple[Values, Values]:
        """Accuracies on the way of the last mission, flown again, and the energy that each of them took."""
        interests = [blended(self.before, self.flown[agent]) for agent in self.agents]
        curve = self._fly(interests, lambda flown: flown.captured[-1] >= self.captured)
        at = np.linspace(len(curve.accuracy) / 2, len(curve.accuracy) - 1, LEVELS).round().astype(np.int64)
        accuracies = np.maximum.accumulate(curve.accuracy)[at]
        return accuracies, np.array([curve.energy_at(accuracy) for accuracy in accuracies])

    def _fly(self, interests: Sequence[InterestWeights], is_over: Callable[[_Curve], bool]) -> _Curve:
        grid = self.layout.grid
        scouts = [Scout(start, interest) for start, interest in zip(self.layout.starts, interests, strict=True)]
        swarm, curve = Swarm(grid, self.energy, scouts, Tactics()), _Curve()
        mean = float(np.nanmean(self.values))
        true = classes(self.values.reshape(grid.valid.shape), mean)

        def watch() -> bool:
            found = classes(likely_values(swarm.belief.prediction(), mean), mean)
            curve.accuracy.append(float((found == true)[grid.valid].mean()))
            curve.energy_j.append(swarm.spent_j)
            curve.captured.append(len(swarm.captured))
            return is_over(curve)

        swarm.fly(lambda cell: float(self.values[cell]), watch)
        return curve


@dataclass(eq=False)
class _Curve:
    """Accuracy of the map, energy spent and cells captured, look by look."""

    accuracy: list[float] = field(default_factory=list)
    energy_j: list[float] = field(default_factory=list)
    captured: list[int] = field(default_factory=list)

    def energy_at(self, accuracy: float) -> float:
        """Energy with which an accuracy is first reached; all of it where it never is."""
        reached = np.array(self.accuracy) >= accuracy
        return self.energy_j[int(reached.argmax()) if reached.any() else -1]

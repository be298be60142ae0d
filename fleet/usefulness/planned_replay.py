"""Replays of a mission that agents planned together: what it would have cost with other weights over the models.

All fly the last mission again over what its records say of the field until their map of that field is as good as the
one with which the last mission's own weights end after as many captures. What counts is the energy that this takes,
over that of the last mission's weights: what is wrong in the belief is wrong in both. Who needs less of it could have
saved energy, or have seen more: half of each, so that something is learned from missions that missed their goals, where
energy does not count, as well as from those that met them, where captures do not. Agents share one map, so what is good
for one is good for all: every agent's loss is that of the swarm.

The smallest difference leads to other paths, and with them to a tenth more or less of the energy. So missions are flown
from several places, and what models differ by is believed only as far as it is more than these flights differ by.
Source: Efron, Morris 1973, Stein's Estimation Rule and Its Competitors, JASA 68.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Environment
from fleet.energy.accounting import EnergyModel
from fleet.functions.belief import Belief
from fleet.functions.classes import classes, likely_values
from fleet.learning.planner import PlannerModel, blended
from fleet.missions.layout import Layout
from fleet.planning.scouting import Scout
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import InterestWeights, Tactics
from fleet.spec.learning import BELIEVED
from fleet.usefulness.history import Weights
from fleet.usefulness.loss import Effort, MissionLoss

LEVELS = 8
"""Accuracies at which energies are compared, over the second half of the mission: one alone is a matter of luck."""
REPLAYS = 4
"""Flights of each candidate: the first from where the mission took off, the others from elsewhere."""
MOST_IS_REAL = 0.5
"""Share of the variance between candidates that must not be chance for any of it to be believed."""
Values = NDArray[np.float64]


@dataclass(eq=False)
class PlannedReplayer:
    """Flies the last mission again; a `usefulness.weights.Replay`.

    Args:
        layout: Who flew where.
        environment: What was expected there; its truth is what the mission's records say of each cell.
        agents: Names of the agents, in the layout's order.
        captured: How many cells the mission captured.
        flown: Weights of each agent in the last mission.
        before: The models that flew in it.
        after: The models as they fly in the next mission.
        energy: Costs of actions.
        loss: The loss of the last mission.
    """

    layout: Layout
    environment: Environment
    agents: Sequence[str]
    captured: int
    flown: Mapping[str, Weights]
    before: Mapping[str, PlannerModel]
    after: Mapping[str, PlannerModel]
    energy: EnergyModel
    loss: MissionLoss
    _flights: dict[tuple[float, ...], Values] = field(default_factory=dict, init=False)

    def __call__(self, agent: str, candidates: Sequence[Weights]) -> list[float]:
        """The loss with the next models and these weights; the same for every agent."""
        ratios = np.array([self._ratios(blended(self.after, weights)) for weights in candidates])
        return [self.loss.of(self._effort(ratio)) for ratio in believed(ratios).tolist()]

    def _effort(self, ratio: float) -> Effort:
        """That of the last mission, had it needed so many times the energy for the same map."""
        whole, half = self.loss.whole, ratio**0.5
        return Effort(min(1.0, whole.captured / half), whole.energy * half)

    def _ratios(self, interest: InterestWeights) -> Values:
        """Energy of each replay with these weights over that with the last mission's, float64 [REPLAYS]."""
        key = tuple(getattr(interest, name) for name in BELIEVED)
        if key not in self._flights:
            self._flights[key] = np.array([self._ratio(interest, number) for number in range(REPLAYS)])
        return self._flights[key]

    def _ratio(self, interest: InterestWeights, number: int) -> float:
        accuracies, energies_j = self._last[number]
        interests = [interest] * len(self.agents)
        curve = self._fly(interests, number, lambda flown: flown.accuracy[-1] >= accuracies[-1])
        return float(np.mean(np.array([curve.energy_at(accuracy) for accuracy in accuracies]) / energies_j))

    @cached_property
    def _last(self) -> list[tuple[Values, Values]]:
        """Accuracies on the way of the last mission, flown again, and the energy that each of them took, by replay."""
        interests = [blended(self.before, self.flown[agent]) for agent in self.agents]
        found = []
        for number in range(REPLAYS):
            curve = self._fly(interests, number, lambda flown: flown.captured[-1] >= self.captured)
            at = np.linspace(len(curve.accuracy) / 2, len(curve.accuracy) - 1, LEVELS).round().astype(np.int64)
            accuracies = np.maximum.accumulate(curve.accuracy)[at]
            found.append((accuracies, np.array([curve.energy_at(accuracy) for accuracy in accuracies])))
        return found

    def _fly(self, interests: Sequence[InterestWeights], number: int, is_over: Callable[[_Curve], bool]) -> _Curve:
        grid = self.layout.grid
        starts = self.layout.starts
        if number:
            starts = tuple(scout.cell for scout in scattered(grid, len(self.agents), number))
        scouts = [Scout(start, interest) for start, interest in zip(starts, interests, strict=True)]
        swarm, curve = Swarm(Belief.over(self.environment), self.energy, scouts, Tactics()), _Curve()
        assert self.environment.truth is not None
        values = np.where(grid.valid, self.environment.truth, np.nan)
        mean = float(np.nanmean(values))
        true = classes(values, mean)

        def watch() -> bool:
            found = classes(likely_values(swarm.belief.prediction(), mean), mean)
            curve.accuracy.append(float((found == true)[grid.valid].mean()))
            curve.energy_j.append(swarm.spent_j)
            curve.captured.append(len(swarm.captured))
            return is_over(curve)

        swarm.fly(lambda cell: float(values.flat[cell]), watch)
        return curve


def believed(ratios: Values) -> Values:
    """What several flights say of each candidate, drawn to what they say of all as far as they may only be chance.

    Args:
        ratios: float64 [candidates, flights].

    Returns:
        float64 [candidates]: their means m, as c + k (m - c), with c the mean of all, k = 1 - s^2 / v, v the variance
        of the means, and s^2 the part of it that flights of one candidate explain; k is 0 where chance explains half of
        v: learners of weights look at how losses differ among each other, however little that is.
    """
    means = ratios.mean(axis=1)
    if len(means) < 2:
        return np.asarray(means)
    chance = float(ratios.var(axis=1, ddof=1).mean()) / ratios.shape[1]
    varied = float(means.var(ddof=1))
    kept = 1.0 - chance / varied if varied > 0.0 else 0.0
    if kept < MOST_IS_REAL:
        kept = 0.0
    return np.asarray(means.mean() + kept * (means - means.mean()))


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

"""F(G, e): how far the evaluation of a mission is from the goals, as one number.

A mission that misses a goal, or the margin above it, loses more than 1; one that does not loses less than 1, and the
less the lower the metric to minimise is. The sum over n contexts keeps that order (`Objective.contexts`): a parameter
set that meets every goal on every context is always better than one that does not.

Source: paper, section "Reward Shaping and Training", F(e, G), which the paper leaves open.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from fleet.spec.swarm import Goal

PENALTY = 2.0
"""Of missed goals in what optimisers are told: about three times what it costs to come nearer to one (corn field)."""
_BELOW_ONE = 1.0 - 1e-9
_ABOVE_ONE = 1.0 + 1e-9


@dataclass(frozen=True)
class Objective:
    """What a mission is held against.

    Args:
        goals: G of the paper.
        minimise: Metric that decides among missions that meet every goal; "" when none does.
        margin: How far each goal must be over-fulfilled, as a share of the goal.
        contexts: How many losses are added.
    """

    goals: tuple[Goal, ...]
    minimise: str = ""
    margin: float = 0.0
    contexts: int = 1

    def loss(self, metrics: Mapping[str, float], reference: float = 1.0) -> float:
        """Loss of one mission.

        Args:
            metrics: Metrics of Eval() and of the platform; one that is missing or not a number misses its goal fully.
            reference: The metric to minimise when every state is visited; makes the cost a share.
        Returns:
            In (0, 1) / contexts when every goal is met with its margin, else above 1.
        """
        missed = [(goal, self.miss(goal, metrics)) for goal in self.goals]
        if any(miss > 0.0 for _, miss in missed):
            return max(1.0 + sum(goal.weight * miss for goal, miss in missed), _ABOVE_ONE)
        return self._cost(metrics, reference) / self.contexts

    def guide(self, metrics: Mapping[str, float], reference: float = 1.0) -> float:
        """The loss without its jump where a goal is missed: what an optimiser that believes in smooth losses is told.

        Args:
            metrics, reference: As in `loss`.
        Returns:
            The cost and `PENALTY` times how far goals are missed, over the contexts. Its least is that of the loss
            as long as a goal costs less than that to be met.
        Source: Nocedal, Wright: Numerical optimization, 2006, section 17.2 (exact penalties).
        """
        missed = sum(goal.weight * self.miss(goal, metrics) for goal in self.goals)
        return (self._cost(metrics, reference) + PENALTY * missed) / self.contexts

    def met(self, metrics: Mapping[str, float]) -> bool:
        """Whether every goal itself is met, without the margin."""
        return all(_miss(goal, metrics, 0.0) == 0.0 for goal in self.goals)

    def miss(self, goal: Goal, metrics: Mapping[str, float]) -> float:
        """How far one goal is missed: 0 when it is met with the margin, 1 when its metric is missing, else between."""
        return _miss(goal, metrics, self.margin)

    def _cost(self, metrics: Mapping[str, float], reference: float) -> float:
        """The metric to minimise as a share of its reference, squashed into (0, 1); below 1/4 when it is negative."""
        if not self.minimise:
            return 0.5
        value = metrics.get(self.minimise, math.nan)
        if not math.isfinite(value):
            return _BELOW_ONE
        scale = abs(reference) if math.isfinite(reference) and reference != 0.0 else 1.0
        share = value / scale
        cost = 0.25 / (1.0 - share) if share < 0.0 else 0.25 + 0.75 * share / (1.0 + share)
        return min(cost, _BELOW_ONE)


def _miss(goal: Goal, metrics: Mapping[str, float], margin: float) -> float:
    value = metrics.get(goal.metric, math.nan)
    if math.isnan(value):
        return 1.0
    below = 0.0 if goal.at_least is None else _shortfall(goal.at_least, value, margin)
    above = 0.0 if goal.at_most is None else _shortfall(-goal.at_most, -value, margin)
    return max(below, above)


def _shortfall(target: float, value: float, margin: float) -> float:
    """How far a value is below a target and its margin, as a share of the target (of 1 when that is 0), in [0, 1]."""
    least = target + margin * abs(target)
    if value >= least:
        return 0.0
    short = (least - value) / (abs(target) or 1.0)
    return 1.0 if math.isinf(short) else max(short / (1.0 + short), 1e-9)

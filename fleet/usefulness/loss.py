"""An agent's loss: that of the mission, as if every agent had done as this one did.

The loss of a mission is one number for all agents. To tell what one agent's weights did, the mission's metrics are
carried over to what the agent did in its own part: which share of its states it captured, and at which share of the
energy that visiting all of them takes. No truth is needed; what Eval() said of the mission is enough:

    energies and time     in proportion to the share of the energy
    coverage              1 - (1 - m) u
    shares of at least g  1 - (1 - m) u^2
    metrics of at most g  m u^2

with m the metric, and u the share of the states that the agent left unseen over the share that all agents did. Errors
are made in unseen states, and the fewer are seen, the more are made in each: on four fields, for captured shares that
differ by up to 0.1, accuracy by the square is off by less than 0.02 on the mean, and by 0.02 (sd). Other metrics stay
as they are. So the loss is the mean over an error of the metric with a standard deviation of `METRIC_SD`: near a goal
it rises slowly instead of jumping.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fleet.energy.accounting import EnergyModel
from fleet.functions.evaluation import cost_metrics
from fleet.learning.goals import Objective
from fleet.missions.accounting import part_cells, thorough_metrics
from fleet.missions.layout import Layout
from fleet.spec.swarm import Action

METRIC_SD = 0.02
COVERAGE = "coverage"
_DEVIATIONS = (-1.2816, -0.5244, 0.0, 0.5244, 1.2816)
"""Middles of five equally likely parts of a normal distribution."""
_PROPORTIONAL = ("uav_energy_j", "edge_energy_j", "energy_j", "time_s")


@dataclass(frozen=True)
class Effort:
    """What was done in a part of the field, or in all of it.

    Args:
        captured: Share of its states with data that were captured, in [0, 1].
        energy: Energy of the aircraft as a share of visiting and capturing all of them.
    """

    captured: float
    energy: float

    def plus(self, other: Effort, minus: Effort) -> Effort:
        """This effort, changed by the difference of two others, within what is possible."""
        return Effort(
            min(1.0, max(0.0, self.captured + other.captured - minus.captured)),
            max(0.0, self.energy + other.energy - minus.energy),
        )


def effort(layout: Layout, agent: int, captures: int, uav_energy_j: float, energy: EnergyModel) -> Effort:
    """The effort of one agent in its part.

    Args:
        agent: Index of the agent.
        captures: States captured; those outside of the part count as if they were in it.
        uav_energy_j: Energy of its flight.
    """
    return Effort(min(1.0, captures / part_cells(layout, agent)), uav_energy_j / full_energy_j(layout, agent, energy))


def full_energy_j(layout: Layout, agent: int, energy: EnergyModel) -> float:
    """Energy of visiting and capturing every state of an agent's part without a detour."""
    states = energy.move(Action.EAST) + energy.capture()
    return (energy.take_off() + energy.land() + states * part_cells(layout, agent)).energy_j


def thorough_costs(layout: Layout, energy: EnergyModel) -> dict[str, float]:
    """Costs of a mission in which every agent visits and captures its part without a detour, by name of the metric."""
    return cost_metrics(thorough_metrics(layout, [str(agent) for agent in range(layout.agents)], energy))


@dataclass(frozen=True)
class MissionLoss:
    """The loss of a mission, and of what it would have been.

    Args:
        objective: Goals, and the metric that decides when they are met.
        metrics: What Eval() said.
        whole: The effort of all agents together.
        reference: The metric to minimise when every state is visited; 1 when that is not known.
    """

    objective: Objective
    metrics: Mapping[str, float]
    whole: Effort
    reference: float = 1.0

    def of(self, part: Effort) -> float:
        """The loss as if every agent had done as in one part."""
        carried = self.carried(part)
        shaken = [self._shaken(carried, METRIC_SD * deviation) for deviation in _DEVIATIONS]
        return float(np.mean([self.objective.loss(metrics, self.reference) for metrics in shaken]))

    def carried(self, part: Effort) -> dict[str, float]:
        """The metrics as if every agent had done as in one part."""
        carried = dict(self.metrics)
        if self.whole.energy > 0:
            for name in set(_PROPORTIONAL) & carried.keys():
                carried[name] *= part.energy / self.whole.energy
        if self.whole.captured >= 1.0:  # nothing is known of what it is to leave states unseen
            return carried
        unseen = (1.0 - part.captured) / (1.0 - self.whole.captured)
        for goal in self.objective.goals:
            value = self.metrics.get(goal.metric)
            if value is None or goal.metric in _PROPORTIONAL:
                continue
            if goal.metric == COVERAGE:
                carried[goal.metric] = 1.0 - (1.0 - value) * unseen
            elif goal.at_least is not None and 0.0 <= value <= 1.0:
                carried[goal.metric] = 1.0 - (1.0 - value) * unseen**2
            elif goal.at_most is not None:
                carried[goal.metric] = value * unseen**2
        return carried

    def _shaken(self, carried: dict[str, float], error: float) -> dict[str, float]:
        uncertain = {goal.metric for goal in self.objective.goals} - set(_PROPORTIONAL)
        return {name: value + error if name in uncertain else value for name, value in carried.items()}

"""Whole missions of a Planner in the simulator, judged by Eval()."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.energy.accounting import EnergyModel
from fleet.functions.belief import Belief
from fleet.functions.contract import EvalClient, Evaluation, Metrics
from fleet.learning.reward import PlannerReward
from fleet.missions.accounting import agent_metrics
from fleet.planning.scouting import Scout
from fleet.planning.swarm import Swarm
from fleet.planning.tactics import InterestWeights, Tactics
from fleet.simulator.evaluation import feature_space
from fleet.simulator.terrain import Terrain


@dataclass(frozen=True)
class PlannedMission:
    """How a Planner's missions are flown.

    Args:
        planner: What is mapped, and when to land.
        interest: What makes a capture interesting.
        energy: What flights cost.
    """

    planner: PlannerReward
    interest: InterestWeights
    energy: EnergyModel

    def fly(self, terrain: Terrain, scouts: Sequence[Scout]) -> Swarm:
        """Fly over a terrain until the agents land."""
        values = terrain.ssv[:, terrain.features.index(self.planner.feature)]
        tactics = Tactics(weights=self.interest)
        swarm = Swarm(Belief.over(terrain.environment), self.energy, scouts, tactics, self.planner.rule)
        swarm.fly(lambda cell: float(values[cell]))
        return swarm


def spent(swarm: Swarm, agents: Sequence[str]) -> Metrics:
    """What the agents have spent when they land where they are."""
    pairs = zip(agents, swarm.traces, strict=True)
    return Metrics(tuple(agent_metrics(name, one.odometer.counts, swarm.energy, 1, 1) for name, one in pairs))


def evaluated(evaluator: EvalClient, terrain: Terrain, cells: Sequence[int], metrics: Metrics) -> Evaluation:
    """Eval() of a mission that captured these cells.

    Raises:
        FunctionError: Eval() failed.
    """
    captured: NDArray[np.bool_] = np.zeros(terrain.environment.grid.cells, dtype=np.bool_)
    captured[list(cells)] = True
    return evaluator.evaluate(feature_space(terrain, captured), metrics)

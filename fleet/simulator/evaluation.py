"""Eval() of simulated missions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fleet.energy.accounting import EnergyModel
from fleet.functions.contract import EvalClient, Evaluation, FeatureSpace, Metrics
from fleet.missions.accounting import agent_metrics
from fleet.simulator.batch import Flown
from fleet.simulator.terrain import Terrain


def evaluate_missions(
    terrain: Terrain, flown: Flown, agents: Sequence[str], energy: EnergyModel, evaluator: EvalClient
) -> list[Evaluation]:
    """Eval() of each mission, in order.

    Args:
        terrain: Where the missions were flown.
        flown: What they did.
        agents: Names of the agents, in the layout's order.
        energy: What each agent's actions cost.
        evaluator: Eval().

    Raises:
        FunctionError: Eval() failed.
    """
    return [
        evaluator.evaluate(
            feature_space(terrain, flown.captured[mission]), mission_metrics(terrain, flown, mission, agents, energy)
        )
        for mission in range(len(flown.captured))
    ]


def mission_metrics(
    terrain: Terrain, flown: Flown, mission: int, agents: Sequence[str], energy: EnergyModel
) -> Metrics:
    """What each agent of a mission spent; arguments as in `evaluate_missions`."""
    parts = terrain.layout.parts
    return Metrics(
        tuple(
            agent_metrics(
                name,
                flown.counts(mission, agent),
                energy,
                groups=parts[agent][1] - parts[agent][0],
                explored=int(flown.groups_explored[mission, agent]),
            )
            for agent, name in enumerate(agents)
        )
    )


def feature_space(terrain: Terrain, captured: NDArray[np.bool_]) -> FeatureSpace:
    """FS of a mission that captured these cells, bool [cells]."""
    states = np.flatnonzero(captured)
    return FeatureSpace(terrain.features, states, terrain.ssv[states], terrain.environment)

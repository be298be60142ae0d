"""How SA of a Planner learns: from simulated missions before the first one is flown, and from records after each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fleet.contexts.grid import Grid
from fleet.learning.planner import Evidence, PlannerModel
from fleet.learning.practice import Grounds
from fleet.learning.reward import RewardModel
from fleet.missions.records import Record
from fleet.planning.gains import gains
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import Tactics
from fleet.randomness import named_seed


def first_planner(reward: RewardModel) -> PlannerModel:
    """A model that knows what shaping found."""
    return PlannerModel.blank(reward.features, reward.of_planner.weights)


def train_planner(model: PlannerModel, grounds: Grounds, reward: RewardModel, missions: int, seed: int) -> PlannerModel:
    """The first model: it learns what captures brought in simulated missions.

    Args:
        model: To start from.
        grounds: The training contexts; there may be none.
        reward: What shaping found.
        missions: How many are simulated over each context.
        seed: Fixes where agents take off.
    Raises:
        MissionError: the reward is none of a Planner.
    """
    planner = reward.of_planner
    for terrain in grounds.terrains:
        grid, values = terrain.environment.grid, terrain.ssv[:, terrain.features.index(planner.feature)]
        for number in range(missions):
            scouts = scattered(grid, len(grounds.agents), named_seed(seed, f"training/{number}"))
            swarm = Swarm(grid, grounds.energy, scouts, Tactics(weights=planner.weights), planner.rule)
            swarm.fly(lambda cell, values=values: float(values[cell]))  # type: ignore[misc]  # lambda's default
            model = model.updated(Evidence(*gains(grid, swarm.captured, values)))
    return model


def retrain_planner(
    model: PlannerModel, logs: Mapping[str, Sequence[Record]], grid: Grid, reward: RewardModel
) -> tuple[PlannerModel, int]:
    """Update a model with what the agents of a subset have captured, as if they had flown alone.

    Args:
        model: The subset's last model; the initial one when it has none.
        logs: Records of the mission by agent.
        grid: Where it flew.
    Returns:
        The new model, and the number of captures that it learned from.
    Raises:
        MissionError: the reward is none of a Planner.
    """
    column = reward.features.index(reward.of_planner.feature)
    captures = sorted(
        (record.time_s, agent, record.cell, record.ssv[column])
        for agent in logs
        for record in logs[agent]
        if record.captured
    )
    if not captures:
        return model, 0
    known = np.full(grid.cells, np.nan)
    for _, _, cell, value in captures:
        known[cell] = value
    evidence = Evidence(*gains(grid, [cell for _, _, cell, _ in captures], known))
    return model.updated(evidence), len(evidence)

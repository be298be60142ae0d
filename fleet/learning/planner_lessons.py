"""How SA of a Planner learns: from simulated missions before the first one is flown, and from records after each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fleet.contexts.base import Environment
from fleet.functions.belief import Belief
from fleet.learning.planned_missions import PlannedMission
from fleet.learning.planner import Evidence, PlannerModel
from fleet.learning.practice import Grounds
from fleet.learning.progress import Progress
from fleet.learning.reward import PlannerReward, RewardModel
from fleet.learning.run import Run
from fleet.learning.workers import Workers
from fleet.missions.records import Record
from fleet.planning.gains import gains
from fleet.planning.swarm import scattered
from fleet.randomness import named_seed

STAGE = "Training"
AT_ONCE = 4
"""Missions between two words about progress."""


def first_planner(reward: RewardModel) -> PlannerModel:
    """A model that knows what shaping found."""
    return PlannerModel.blank(reward.features, reward.of_planner.weights)


def train_planner(model: PlannerModel, grounds: Grounds, reward: RewardModel, missions: int, run: Run) -> PlannerModel:
    """The first model: it learns what captures brought in simulated missions.

    Args:
        model: To start from.
        grounds: The training contexts; there may be none.
        reward: What shaping found.
        missions: How many are simulated over each context.
        run: Seed and workers; the result does not depend on the latter.
    Raises:
        TrainingError: the reward is none of a Planner.
    """
    flights = [(terrain, number) for number in range(missions) for terrain in range(len(grounds.terrains))]
    with Workers(run.workers, Problem(grounds, reward.of_planner, run.seed)) as workers:
        for done in range(0, len(flights), AT_ONCE):
            for evidence in workers.map(fly, flights[done : done + AT_ONCE]):
                model = model.updated(evidence)
            run.listener(Progress(STAGE, min(done + AT_ONCE, len(flights)), len(flights)))
    return model


@dataclass(frozen=True, eq=False)
class Problem:
    """What every mission of training is given; worker processes get a copy."""

    grounds: Grounds
    planner: PlannerReward
    seed: int


def fly(problem: Problem, item: tuple[int, int]) -> Evidence:
    """What captures brought in one mission, (its context, its number)."""
    index, number = item
    grounds, planner = problem.grounds, problem.planner
    terrain = grounds.terrains[index]
    grid, values = terrain.environment.grid, terrain.ssv[:, terrain.features.index(planner.feature)]
    scouts = scattered(grid, len(grounds.agents), named_seed(problem.seed, f"training/{number}"))
    swarm = PlannedMission(planner, planner.weights, grounds.energy).fly(terrain, scouts)
    return Evidence(*gains(Belief.over(terrain.environment), swarm.captured, values))


def retrain_planner(
    model: PlannerModel, logs: Mapping[str, Sequence[Record]], environment: Environment, reward: RewardModel
) -> tuple[PlannerModel, int]:
    """Update a model with what the agents of a subset have captured, as if they had flown alone.

    Args:
        model: The subset's last model; the initial one when it has none.
        logs: Records of the mission by agent, in the fleet's order.
        environment: Where it flew.
    Returns:
        The new model, and the number of captures that it learned from.
    Raises:
        MissionError: the reward is none of a Planner.
    """
    column = reward.features.index(reward.of_planner.feature)
    captures = sorted(
        (record.time_s, index, record.cell, record.ssv[column])
        for index, log in enumerate(logs.values())
        for record in log
        if record.captured
    )
    if not captures:
        return model, 0
    known = np.full(environment.grid.cells, np.nan)
    for _, _, cell, value in captures:
        known[cell] = value
    evidence = Evidence(*gains(Belief.over(environment), [cell for _, _, cell, _ in captures], known))
    return model.updated(evidence), len(evidence)

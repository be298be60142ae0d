"""Missions over contexts, where the truth is known: what a swarm claims there teaches it when to stop."""

from __future__ import annotations

import numpy as np

from fleet.contexts.base import Environment
from fleet.energy.accounting import EnergyModel
from fleet.errors import ContextError
from fleet.functions.belief import Belief
from fleet.functions.classes import class_mean, classes, likely_values
from fleet.planning.stop import Claims
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import Tactics


def rehearse(environment: Environment, energy: EnergyModel, agents: int, tactics: Tactics, seed: int) -> Claims:
    """Fly over a context until every cell is captured.

    Raises:
        ContextError: the truth is not known there.
        MissionError: there are fewer cells with data than agents.
    """
    if environment.truth is None:
        raise ContextError(f"nothing is known of the truth in {environment.name}, so nothing can be learned from it")
    values = environment.truth.reshape(-1)
    mean = class_mean(environment.truth, environment)
    truth = classes(environment.truth, mean)
    swarm = Swarm(Belief.over(environment), energy, scattered(environment.grid, agents, seed), tactics)
    found: list[float] = []
    spent_j: list[float] = []

    def hold_against_truth() -> bool:
        map_of_classes = classes(likely_values(swarm.belief.prediction(), mean), mean)
        found.append(float((map_of_classes == truth)[environment.grid.valid].mean()))
        spent_j.append(swarm.spent_j)
        return False

    swarm.fly(lambda cell: float(values[cell]), watch=hold_against_truth)
    claimed = np.array([claim.accuracy for claim in swarm.claims])
    predictions = np.array([claim.predictions for claim in swarm.claims], dtype=np.int64)
    return Claims(claimed, np.array(found), predictions, np.array(spent_j))

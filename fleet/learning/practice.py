"""SA learns from simulated missions, and is judged by them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fleet.energy.accounting import EnergyModel
from fleet.functions.contract import EvalClient
from fleet.learning.experience import choices, concatenate
from fleet.learning.model import Fit, SAModel, Transitions
from fleet.learning.reward import Normaliser, RewardModel
from fleet.learning.score_tables import ALONE, NEVER, Flights, batch_of, score_table
from fleet.missions.documents import INITIAL
from fleet.missions.layout import MOVES
from fleet.randomness import named_seed
from fleet.simulator.batch import Batch, fly
from fleet.simulator.evaluation import evaluate_missions
from fleet.simulator.terrain import Terrain
from fleet.spec.learning import SASpec

ROUNDS = 4
"""How often SA is updated: each round flies with what the rounds before have learned."""
SAMPLED = 64
"""Transitions that each mission adds to the update of its round, on average: missions repeat each other."""
EPOCHS = 2
"""Passes over the transitions of a round."""


@dataclass(frozen=True, eq=False)
class Grounds:
    """Where missions are simulated, and what judges them. Can be pickled: worker processes get a copy.

    Args:
        terrains: The mapped contexts, at least one.
        agents: Names of the agents, in the order of the layouts.
        energy: What flights cost.
        evaluator: Eval().
    """

    terrains: tuple[Terrain, ...]
    agents: tuple[str, ...]
    energy: EnergyModel
    evaluator: EvalClient

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the SSV's features."""
        return self.terrains[0].features


@dataclass(frozen=True)
class Practice:
    """How SA learns.

    Args:
        missions: Simulated missions, shared out evenly among the terrains.
        exploration: Share of random moves.
        learning_rate: Alpha of the first round; it falls with 1 / round.
        seed: Fixes the missions and the order of learning.
    """

    missions: int
    exploration: float
    learning_rate: float
    seed: int

    @staticmethod
    def of(sa: SASpec, missions: int, seed: int) -> Practice:
        """As the FleetSpec says."""
        return Practice(missions, sa.exploration, sa.learning_rate, seed)


def practise(model: SAModel, reward: RewardModel, terrains: Sequence[Terrain], practice: Practice) -> SAModel:
    """A model that has learned from simulated missions with a reward, by its own policy and some exploration."""
    rounds = max(1, min(ROUNDS, practice.missions // len(terrains)))
    for number in range(rounds):
        sample = _fly_round(model, reward, terrains, practice, (number, rounds))
        fit = Fit(EPOCHS, practice.learning_rate / (1 + number), named_seed(practice.seed, f"order/{number}"))
        model = model.updated(sample, fit)
    return model


def _fly_round(
    model: SAModel, reward: RewardModel, terrains: Sequence[Terrain], practice: Practice, turn: tuple[int, int]
) -> Transitions:
    """Transitions of the missions of one round, (its number, how many there are), over all terrains."""
    number, rounds = turn
    generator = np.random.default_rng(named_seed(practice.seed, f"sample/{number}"))
    shares = rounds * len(terrains)
    parts = []
    for index, terrain in enumerate(terrains):
        share = number * len(terrains) + index
        first, end = practice.missions * share // shares, practice.missions * (share + 1) // shares
        if first == end:
            continue
        flights = Flights(first, end - first, practice.exploration, named_seed(practice.seed, "missions"))
        batch = batch_of(score_table({INITIAL: model}, ALONE, terrain), reward, terrain, flights)
        trace = fly(terrain.layout, batch, traced=True).trace
        assert trace is not None  # it was asked for
        sample = choices(trace).sample(SAMPLED * flights.count, generator)
        parts.append(sample.transitions(terrain.ssv, batch.rewards[0]))
    return concatenate(parts)


def assess(model: SAModel, reward: RewardModel, grounds: Grounds, flights: Flights) -> list[Mapping[str, float]]:
    """Metrics of missions over each terrain, all of one terrain before the next.

    Raises:
        FunctionError: Eval() failed.
    """
    results = []
    for terrain in grounds.terrains:
        table = score_table({INITIAL: model}, ALONE, terrain)
        results += _evaluate(grounds, terrain, batch_of(table, reward, terrain, flights))
    return results


def visit_everything(grounds: Grounds) -> list[Mapping[str, float]]:
    """Metrics of a mission over each terrain that leaves no state out: what costs are held against."""
    utility, visited = NEVER
    count = len(grounds.features)
    nothing = Normaliser(low=(0.0,) * count, high=(1.0,) * count)
    thorough = RewardModel(
        features=grounds.features, weights=(0.0,) * count, normaliser=nothing,
        utility_threshold=utility, visited_threshold=visited, loss=0.0, goals_met=False,
    )  # fmt: skip
    results = []
    for terrain in grounds.terrains:
        table = np.zeros((len(terrain.ssv), len(MOVES)))
        results += _evaluate(grounds, terrain, batch_of(table, thorough, terrain, Flights()))
    return results


def _evaluate(grounds: Grounds, terrain: Terrain, batch: Batch) -> list[Mapping[str, float]]:
    flown = fly(terrain.layout, batch)
    evaluations = evaluate_missions(terrain, flown, grounds.agents, grounds.energy, grounds.evaluator)
    return [evaluation.metrics for evaluation in evaluations]

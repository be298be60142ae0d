"""How a Planner learns when to land: simulated missions over the shaping contexts, held against Eval().

Each mission flies on long after the map seems good enough. Then it is asked what Eval() would have said, had it ended
by a more or less cautious rule. The least caution is taken with which as many missions as `ha.confidence` says met
every goal with its margin. A mission that ends too early costs the goal, one that ends late only energy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fleet.contexts.base import Expectation
from fleet.errors import ModelError, TrainingError
from fleet.functions.belief import Belief
from fleet.functions.contract import Metrics
from fleet.learning.goals import Objective
from fleet.learning.planned_missions import evaluated, spent
from fleet.learning.practice import Grounds
from fleet.learning.progress import Progress
from fleet.learning.reward import Normaliser, PlannerReward, RewardModel
from fleet.learning.run import Run, objective_of, references
from fleet.learning.workers import Workers
from fleet.missions.accounting import thorough_metrics
from fleet.planning.stop import CAUTIONS, StopRule, usual_caution
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import InterestWeights, Tactics
from fleet.randomness import named_seed
from fleet.spec.resources import Fleet

STAGE = "Shaping"
Ended = Mapping[str, float]
"""Metrics of a mission that ended at some moment."""


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """A mission over a context, by what it would have been had it ended earlier.

    Args:
        claims: Expected accuracy and the number of predictions behind it, at each moment.
        ends: Metrics of Eval() at those moments at which a rule of some caution ends the mission, by index; -1 is the
            end, where the whole field is captured or the most cautious rule was met.
        loss: F of those metrics.
        met: Whether they meet every goal with its margin.
    """

    claims: tuple[tuple[float, int], ...]
    ends: Mapping[int, Ended]
    loss: Mapping[int, float]
    met: Mapping[int, bool]

    def end(self, rule: StopRule) -> int:
        """The moment at which a rule ends the mission."""
        return next((index for index, claim in enumerate(self.claims) if rule.is_met(*claim)), -1)


@dataclass(frozen=True, eq=False)
class Problem:
    """What every rehearsal is given; worker processes get a copy."""

    fleet: Fleet
    grounds: Grounds
    planner: PlannerReward
    reference: tuple[float, ...]
    objective: Objective
    seed: int


def shape_planner(fleet: Fleet, grounds: Grounds, run: Run, normaliser: Normaliser) -> RewardModel:
    """Find how cautious a Planner must be.

    Args:
        fleet: Goals, HA and shaping settings; `epochs` missions are rehearsed, shared out among the contexts.
        grounds: The shaping contexts.
        run: Seed and workers.
        normaliser: Of Map()'s features, for the record.
    Raises:
        TrainingError: there is no shaping context.
        ModelError: Map() does not give the feature that is to be mapped.
        FunctionError: Eval() failed.
    """
    if not grounds.terrains:
        raise TrainingError("no context is for shaping; give one of `contexts` the use Shaping")
    planner = planner_reward(fleet, grounds.features, grounds.terrains[0].environment.truth_name)
    planner = planner.model_copy(update={"expects": _is_told(grounds, planner)})
    total = max(fleet.reward_shaping.epochs * fleet.reward_shaping.periods, len(grounds.terrains))
    objective = objective_of(fleet, 1)
    seed = named_seed(run.seed, "shaping/rehearsals")
    problem = Problem(fleet, grounds, planner, references(fleet, grounds, _everything), objective, seed)
    found: list[Rehearsal] = []
    with Workers(run.workers, problem) as workers:
        while len(found) < total:
            count = min(fleet.reward_shaping.batch, total - len(found))
            found += workers.map(rehearse, list(range(len(found), len(found) + count)))
            run.listener(Progress(STAGE, len(found), total))
    reward = _chosen(fleet, found, planner, grounds.features, normaliser)
    if not reward.goals_met:
        message = f"fewer than {fleet.ha.confidence:.0%} of the rehearsed missions met every goal, however cautious"
        run.listener(Progress(STAGE, total, total, reward.loss, False, message))
    return reward


def given_planner(fleet: Fleet, features: Sequence[str], normaliser: Normaliser, truth_name: str = "") -> RewardModel:
    """The reward of a Planner without a context for shaping: with the caution that is given, or the usual one.

    Args:
        truth_name: The quantity that the other contexts know the truth of; "" when they know none.
    """
    return _reward(planner_reward(fleet, features, truth_name), features, normaliser)


def planner_reward(fleet: Fleet, features: Sequence[str], truth_name: str) -> PlannerReward:
    """What a Planner flies by before anything is shaped.

    Raises:
        ModelError: Map() does not give the feature that is to be mapped, or a weight is given to an unknown feature.
    """
    feature = fleet.sa.feature or (truth_name if truth_name in features else features[0])
    if feature not in features:
        raise ModelError(f"sa.feature is {feature}, but Map() gives {', '.join(features)}; name one of these")
    given = fleet.reward_shaping.weights
    unknown = sorted(set(given) - set(InterestWeights.model_fields))
    if unknown:
        raise ModelError(
            f"rewardShaping.weights names {', '.join(unknown)}; a Planner weighs "
            f"{', '.join(InterestWeights.model_fields)}"
        )
    goal = fleet.accuracy_goal
    if goal is None:
        raise TrainingError("Planner lands when its map is accurate enough, and no goal says so; add one for accuracy")
    caution = usual_caution(goal) if fleet.ha.caution is None else fleet.ha.caution
    weights = InterestWeights().model_copy(update=given)
    return PlannerReward(feature=feature, weights=weights, goal=goal, caution=float(caution))


def rehearse(problem: Problem, number: int) -> Rehearsal:
    """One mission; missions take turns over the contexts, and take off in other places each time."""
    terrain = problem.grounds.terrains[number % len(problem.grounds.terrains)]
    reference = problem.reference[number % len(problem.grounds.terrains)]
    energy, agents = problem.grounds.energy, problem.grounds.agents
    values = terrain.ssv[:, terrain.features.index(problem.planner.feature)]
    scouts = scattered(terrain.environment.grid, len(agents), named_seed(problem.seed, f"{number}"))
    most = StopRule(problem.planner.goal, float(CAUTIONS[-1]))
    swarm = Swarm(Belief.over(terrain.environment), energy, scouts, Tactics(weights=problem.planner.weights), most)
    moments: list[tuple[int, Metrics]] = []

    def watch() -> bool:
        moments.append((len(swarm.captured), spent(swarm, agents)))
        return False

    swarm.fly(lambda cell: float(values[cell]), watch)
    claims = tuple((claim.accuracy, claim.predictions) for claim in swarm.claims)
    rehearsal = Rehearsal(claims, {}, {}, {})
    ends = {}
    for moment in sorted({rehearsal.end(StopRule(most.goal, float(caution))) for caution in _cautions(problem.fleet)}):
        count, metrics = moments[moment]
        ends[moment] = evaluated(problem.grounds.evaluator, terrain, swarm.captured[:count], metrics).metrics
    loss = {moment: problem.objective.loss(metrics, reference) for moment, metrics in ends.items()}
    met = {
        moment: all(problem.objective.miss(goal, metrics) == 0.0 for goal in problem.objective.goals)
        for moment, metrics in ends.items()
    }
    return Rehearsal(claims, ends, loss, met)


def _is_told(grounds: Grounds, planner: PlannerReward) -> bool:
    """Whether Eval() says something else of a mission when it is told what to expect of every cell: the truth."""
    terrain = grounds.terrains[0]
    grid, values = terrain.environment.grid, terrain.ssv[:, terrain.features.index(planner.feature)]
    cells = np.flatnonzero(grid.valid)[::8].tolist()
    costs = thorough_metrics(terrain.layout, grounds.agents, grounds.energy)
    expected = Expectation(values.reshape(grid.valid.shape), np.zeros(grid.valid.shape))
    told = replace(terrain.environment, expected=expected)
    terrains = (terrain, replace(terrain, environment=told))
    untold, of_told = (evaluated(grounds.evaluator, each, cells, costs).metrics for each in terrains)
    return untold != of_told


def _everything(grounds: Grounds) -> list[Ended]:
    """Metrics of a mission over each context that captures every cell, each agent its part without a detour."""
    found = []
    for terrain in grounds.terrains:
        costs = thorough_metrics(terrain.layout, grounds.agents, grounds.energy)
        cells = np.flatnonzero(terrain.environment.grid.valid).tolist()
        found.append(evaluated(grounds.evaluator, terrain, cells, costs).metrics)
    return found


def _cautions(fleet: Fleet) -> Sequence[float]:
    return [fleet.ha.caution] if fleet.ha.caution is not None else CAUTIONS.tolist()


def _chosen(
    fleet: Fleet, found: Sequence[Rehearsal], planner: PlannerReward, features: Sequence[str], normaliser: Normaliser
) -> RewardModel:
    """The least cautious rule with which enough missions met every goal; the most cautious one when none does."""
    for caution in _cautions(fleet):
        ends = [each.end(StopRule(planner.goal, float(caution))) for each in found]
        met = [each.met[end] for each, end in zip(found, ends, strict=True)]
        if np.mean(met) >= fleet.ha.confidence:
            break
    loss = float(np.mean([each.loss[end] for each, end in zip(found, ends, strict=True)]))
    shaped = planner.model_copy(update={"caution": float(caution)})
    update = {
        "loss": loss,
        "goals_met": bool(np.mean(met) >= fleet.ha.confidence),
        "evaluations": len(found),
        "successes": int(np.sum(met)),
    }
    return _reward(shaped, features, normaliser).model_copy(update=update)


def _reward(planner: PlannerReward, features: Sequence[str], normaliser: Normaliser) -> RewardModel:
    return RewardModel(
        features=tuple(features),
        weights=(0.0,) * len(features),
        normaliser=normaliser,
        utility_threshold=0.0,
        visited_threshold=0,
        loss=0.0,
        goals_met=False,
        planner=planner,
    )

"""Do replays of a mission's own records help to find weights over the models?

    python -m bench.replays [--seeds 8] [--missions 5] [--fields synthetic 2018-06-01 ...]

Four agents fly a field several times. SA was trained on another field; after each mission the models of all subsets
of agents are retrained. Two models are planted among them: a useless one (random scores) and a harmful one (of 24
random models the one that loses most when it is flown alone). Weights are proposed with replays, without, and not at
all (uniform; first model alone). The same seeds go through all four, so differences are paired. The goal is what the
first model reaches minus 0.10 (slack: only energy counts) or plus 0.01 (tight: accuracy counts).

Measured (8 seeds, 5 missions, mean loss of missions 2 to 5; difference to the first model alone, and paired difference
of replays to none, with standard errors). About 0.5 is a met goal, above 1 a missed one:

    field, goal        rank   EI, no replays     EI, 16 replays     replays - none     better
    synthetic  -0.10   0.81   -0.000 +- 0.000    -0.001 +- 0.001    -0.001 +- 0.001    75 %
    synthetic  +0.01   0.20   +0.000 +- 0.001    -0.002 +- 0.002    -0.002 +- 0.002    75 %
    2018-06-01 -0.10   0.77   +0.028 +- 0.033    -0.010 +- 0.015    -0.038 +- 0.025    50 %
    2018-06-01 +0.01   0.65   -0.009 +- 0.009    -0.082 +- 0.024    -0.073 +- 0.020    88 %
    2018-08-02 -0.10   0.72   +0.024 +- 0.015    -0.008 +- 0.002    -0.032 +- 0.015    88 %
    2018-08-02 +0.01   0.82   +0.005 +- 0.004    -0.011 +- 0.005    -0.016 +- 0.007    75 %
    2018-09-16 -0.10   0.96   +0.000 +- 0.001    +0.000 +- 0.003    -0.000 +- 0.003    88 %
    2018-09-16 +0.01   0.53   -0.001 +- 0.001    -0.005 +- 0.002    -0.004 +- 0.002    75 %

So replays help or do no harm, and 16 of them are the default. Without them, expected improvement is no better than
never changing the weights, and worse on two fields. Two things to know: gains are small where models hardly differ in
what they make an agent do; and where accuracy depends on which states are seen rather than on how many (synthetic,
tight goal: rank correlation 0.20), replays do not find the harmful model (mean weight 0.10; uniform weights 0.06).
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from bench.measure import Result
from bench.missions import AGENTS, ENERGY, FEATURES, Outcome, World, alone, objective, shaken, trained, world_of
from fleet.aggregation.retrain import retrain
from fleet.aggregation.subsets import Subset, subsets_for
from fleet.learning.model import SAModel
from fleet.learning.qlearning import QLearning
from fleet.missions.documents import INITIAL
from fleet.spec.learning import OnlineLearning, Retraining, SASpec, WeightLearner
from fleet.spec.resources import Fleet
from fleet.usefulness.belief import believed_ssv
from fleet.usefulness.history import History, Observation
from fleet.usefulness.replay import Replayer
from fleet.usefulness.weights import first_weights, propose_weights

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
FIELDS = ("synthetic", "2018-06-01", "2018-08-02", "2018-09-16")
TIGHTNESS = (-0.1, 0.01)
USELESS, HARMFUL = "useless", "harmful"
ALONE, UNIFORM, WITHOUT, WITH = "first model alone", "uniform", "EI, no replays", "EI, 16 replays"
ARMS: dict[str, OnlineLearning | None] = {
    ALONE: None,
    UNIFORM: OnlineLearning(weights=WeightLearner.UNIFORM, replays=0),
    WITHOUT: OnlineLearning(weights=WeightLearner.EXPECTED_IMPROVEMENT, replays=0),
    WITH: OnlineLearning(weights=WeightLearner.EXPECTED_IMPROVEMENT, replays=16),
}


@dataclass(frozen=True, eq=False)
class Case:
    """One field and goal over several seeds.

    Args:
        losses: Of each arm, the mean over the missions after the first, [seeds].
        harm: Of each arm, the mean weight that the harmful model got, [seeds].
        ranks: Rank correlation of replayed with true losses, [seeds].
        worst: How much more the harmful model loses than the first one, [seeds].
    """

    name: str
    losses: dict[str, list[float]]
    harm: dict[str, list[float]]
    ranks: list[float]
    worst: list[float]

    def gain(self, arm: str, base: str) -> NDArray[np.float64]:
        """By how much an arm loses more than another, [seeds]."""
        return np.array(self.losses[arm]) - np.array(self.losses[base])


def planted(world: World, seed: int) -> dict[str, SAModel]:
    """A useless and a harmful model."""
    generator = np.random.default_rng(seed)
    blank = QLearning.blank(SASpec(), FEATURES, world.reward.normaliser, seed)
    chance = [replace(blank, weights=generator.normal(size=blank.weights.shape)) for _ in range(24)]
    worst = int(np.argmax([alone(world, model).smooth for model in chance]))
    return {USELESS: chance[(worst + 1) % 24], HARMFUL: chance[worst]}


@cache
def subsets() -> tuple[Subset, ...]:
    fleet = Fleet.model_validate(
        {
            "agents": {"count": 4},
            "stateSpace": {"context": "c"},
            "map": {"function": "a:b"},
            "eval": {"function": "a:b"},
            "contexts": [{"name": "c", "uri": "c"}],
            "goals": [{"metric": "accuracy", "atLeast": 0.7}],
        }
    )
    return subsets_for(fleet)


def campaign(
    world: World, first: dict[str, SAModel], learning: OnlineLearning | None, missions: int, seed: int
) -> tuple[list[Outcome], list[dict[str, dict[str, float]]]]:
    """All missions of one fleet; learning None flies the first model alone."""
    models = {INITIAL: first[INITIAL]}
    weights = first_weights(AGENTS)
    history = History()
    outcomes, all_weights = [], []
    for number in range(1, missions + 1):
        today = shaken(world, 1000 * seed + number)
        outcome = today.fly(weights, models, log=True)
        outcomes.append(outcome)
        all_weights.append(weights)
        efforts, loss = outcome.efforts, outcome.believed
        seen = tuple(Observation(number, agent, weights[agent], loss.of(efforts[agent])) for agent in AGENTS)
        history = History(history.observations + seen)
        if learning is None:
            continue
        before = models
        models = dict(first)
        for subset in subsets():
            start = before.get(subset.key, first[INITIAL])
            logs = outcome.logs
            models[subset.key] = retrain(start, logs, subset, world.reward, learning.retraining, seed + number)[0]
        replayer = None
        if learning.replays:
            belief = believed_ssv(world.field.environment.grid, outcome.logs)
            layout = world.field.layout
            replayer = Replayer(layout, AGENTS, belief, weights, before, models, world.reward, ENERGY, loss, efforts)
        weights = propose_weights(history, list(models), AGENTS, learning, seed, replayer)
    return outcomes, all_weights


def rank_correlation(world: World, first: dict[str, SAModel], seed: int) -> float:
    """How well replays order weights: rank correlation with the true loss over single models and mixtures."""
    flown = world.fly(first_weights(AGENTS), first, log=True)
    models = dict(first)
    for subset in subsets():
        models[subset.key] = retrain(first[INITIAL], flown.logs, subset, world.reward, Retraining(), seed)[0]
    belief = believed_ssv(world.field.environment.grid, flown.logs)
    replayer = Replayer(
        world.field.layout, AGENTS, belief, first_weights(AGENTS), first, models, world.reward, ENERGY,
        flown.believed, flown.efforts,
    )  # fmt: skip
    keys = sorted(models)
    points = np.concatenate([np.eye(len(keys)), np.random.default_rng(seed).dirichlet(np.full(len(keys), 0.3), 24)])
    candidates = [dict(zip(keys, point.tolist(), strict=True)) for point in points]
    believed = np.mean([replayer(agent, candidates) for agent in AGENTS], axis=0)
    true = [world.fly(dict.fromkeys(AGENTS, candidate), models, log=False) for candidate in candidates]
    return float(spearmanr(believed, [each.smooth for each in true])[0])


def measure(field: str, tightness: float, seeds: int, missions: int) -> Case:
    """Fly all arms."""
    case = Case(f"{field}, goal {tightness:+.2f}", defaultdict(list), defaultdict(list), [], [])
    for seed in range(seeds):
        world, known = world_of(field, seed, DATA)
        first: dict[str, SAModel] = {INITIAL: trained(known.field, world.reward, seed)}
        goal = objective(alone(world, first[INITIAL]).accuracy + tightness)
        world = replace(world, objective=goal)
        first |= planted(world, seed)
        case.worst.append(alone(world, first[HARMFUL]).smooth - alone(world, first[INITIAL]).smooth)
        case.ranks.append(rank_correlation(world, first, seed))
        for arm, learning in ARMS.items():
            outcomes, weights = campaign(world, first, learning, missions, seed)
            case.losses[arm].append(float(np.mean([each.smooth for each in outcomes[1:]])))
            given = [[own.get(HARMFUL, 0.0) for own in each.values()] for each in weights[1:]]
            case.harm[arm].append(float(np.mean(given)))
    return case


def report(case: Case) -> None:
    """Print a case."""
    print(f"== {case.name} of what the first model reaches")
    print(f"rank correlation of replayed and true losses {np.mean(case.ranks):.2f}")
    print(f"the harmful model flown alone: loss {np.mean(case.worst):+.4f}")
    for arm, values in case.losses.items():
        gain, harm = _mean(case.gain(arm, ALONE)), np.mean(case.harm[arm])
        print(f"{arm:18} loss {np.mean(values):.4f}, {gain} of first; weight of harmful {harm:.3f}")
    difference = case.gain(WITH, WITHOUT)
    print(f"replays - none: {_mean(difference)}, better for {np.mean(difference < 0):.0%} of the seeds", flush=True)


def _mean(values: NDArray[np.float64]) -> str:
    """Mean and its standard error."""
    return f"{values.mean():+.4f} +- {values.std(ddof=1) / np.sqrt(len(values)):.4f}"


def run() -> list[Result]:
    """The short form for `make bench`: the real field where the data is there, else synthetic ones."""
    fields: Sequence[str] = FIELDS[:2] if (DATA / "corn-cube").is_dir() else FIELDS[:1]
    cases = [measure(field, tightness, seeds=4, missions=4) for field in fields for tightness in TIGHTNESS]
    command = f"python -m bench.replays --seeds 4 --missions 4 --fields {' '.join(fields)}"
    return [
        Result.against(
            f"mission loss with replays, {case.name}", float(np.mean(case.losses[WITH])), "loss",
            ("without replays", float(np.mean(case.losses[WITHOUT]))), command,
        )
        for case in cases
    ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--missions", type=int, default=5)
    parser.add_argument("--fields", nargs="+", default=FIELDS)
    arguments = parser.parse_args()
    for field in arguments.fields:
        for tightness in TIGHTNESS:
            report(measure(field, tightness, arguments.seeds, arguments.missions))


if __name__ == "__main__":
    main()

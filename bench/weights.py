"""Which learner of the weights over the models brings goals nearer from mission to mission, when fields drift?

    python -m bench.weights [--seeds 10] [--missions 10] [--fields corn-dates 2018-06-01 ...] [--arms Uniform ...]
        [--processes 1]

Four agents fly a field again and again. SA was trained on another field; after each mission the models of all subsets
of agents are retrained from its records. Two models are planted among them, of 24 with random scores that are flown
alone on the first, the middle and the last day: the harmful one loses most, the useless one next to most. From
mission to mission the field drifts: a smooth random field of a fifth of its deviation is added to every feature and to
the truth, and 10 % of noise to what is seen. `corn-dates` flies the three dates of the corn field in order, drifting
between them; the others one field each. The goal is what the first model reaches on each date before it drifts, minus
0.10 (slack: only energy counts) or plus 0.01 (tight: accuracy counts). The same fields and seeds go through all
learners, so differences are paired; intervals (95 %, `bench.statistics`) are over the campaigns.

Some arms leave out work as the platform does: models whose usefulness stays low are pruned, or models are suspended
while their usefulness gives level 0, which is Absolute (the paper's) or Relative to the largest.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from bench.measure import Result
from bench.missions import AGENTS, ENERGY, FEATURES, Outcome, World, alone, objective, shaken, trained, world_of
from bench.replays import DATA, HARMFUL, TIGHTNESS, USELESS, subsets
from bench.statistics import interval, paired
from fleet.aggregation.retrain import retrain
from fleet.aggregation.subsets import Subset
from fleet.learning.model import SAModel
from fleet.learning.qlearning import QLearning
from fleet.missions.documents import INITIAL
from fleet.spec.learning import OnlineLearning, SASpec, WeightLearner
from fleet.spec.platform import Pruning, UsefulnessScale
from fleet.usefulness.belief import believed_ssv
from fleet.usefulness.history import History, Observation
from fleet.usefulness.replay import Replayer
from fleet.usefulness.weights import first_weights, propose_weights, usefulness
from fleet_operator.policy.level import levels
from fleet_operator.policy.pruning import pruned

OUT = Path(__file__).resolve().parent / "out" / "weights.json"
FIELDS = ("corn-dates", "2018-06-01", "2018-08-02", "2018-09-16", "synthetic")
DATES = ("2018-06-01", "2018-08-02", "2018-09-16")
DRIFT = 0.2
"""Of one mission, in standard deviations of each feature."""
DRIFT_CELLS = 4.0
NOT_PRUNED = Pruning()
PRUNING = Pruning(below=0.02, after=2)
"""A third of the share that each of the 18 models would have if all were alike."""
RANDOM = 24
FIRST_ALONE = "first model alone"
EI, UNIFORM, HEDGE, BEST = (
    WeightLearner.EXPECTED_IMPROVEMENT,
    WeightLearner.UNIFORM,
    WeightLearner.MULTIPLICATIVE_WEIGHTS,
    WeightLearner.BEST_BY_REPLAY,
)


@dataclass(frozen=True)
class Arm:
    """A learner of weights, None for none, whether useless models are pruned, and how levels are made of usefulness.

    Args:
        scale: None retrains models of every level.
    """

    learner: WeightLearner | None
    pruning: Pruning = NOT_PRUNED
    scale: UsefulnessScale | None = None

    @property
    def plain(self) -> str:
        """The name of the arm that leaves out no work."""
        return FIRST_ALONE if self.learner is None else self.learner.value

    @property
    def name(self) -> str:
        """For tables."""
        levels_by = f", levels {self.scale}" if self.scale else ""
        return f"{self.plain}{', pruned' if self.pruning.below else ''}{levels_by}"

    def retrained(self, useful: Sequence[Mapping[str, float | None]]) -> list[Subset]:
        """The subsets whose models are retrained after a mission.

        Args:
            useful: Usefulness of each model after each mission before; the last is what the mission flew with.
        """
        open_ones = {subset.key: subset for subset in subsets() if subset.key not in pruned(useful, self.pruning)}
        if self.scale is not None:
            known = useful[-1] if useful else {}
            by_model = levels({**dict.fromkeys(open_ones), **known}, self.scale)
            open_ones = {key: subset for key, subset in open_ones.items() if by_model[key] > 0}
        return list(open_ones.values())


LEARNERS = (Arm(None), *(Arm(each) for each in (EI, UNIFORM, HEDGE, BEST)))
SAVING = (
    Arm(HEDGE, PRUNING),
    *(Arm(learner, scale=scale) for learner in (HEDGE, EI) for scale in UsefulnessScale),
)
ARMS = {arm.name: arm for arm in (*LEARNERS, *SAVING)}


@dataclass(frozen=True, eq=False)
class Campaign:
    """What became of one arm: each per mission.

    Args:
        losses: Of the mission, without the jump at the goal.
        given: Mean weight of the useless and of the harmful model.
        largest: Mean of the largest weight that each agent gave: how far weights are concentrated.
        retrained: Models that were retrained after it.
        accuracies: Of the mission's map.
    """

    losses: list[float] = field(default_factory=list)
    given: dict[str, list[float]] = field(default_factory=lambda: {USELESS: [], HARMFUL: []})
    largest: list[float] = field(default_factory=list)
    retrained: list[int] = field(default_factory=list)
    accuracies: list[float] = field(default_factory=list)


def drifting(worlds: Sequence[World], missions: int, seed: int) -> Iterator[World]:
    """The field of each mission; of several fields each has an equal share of the missions, one after the other."""
    for number in range(missions):
        world = worlds[number * len(worlds) // missions]
        for past in range(number):
            world = _drifted(world, 1000 * seed + past)
        yield shaken(world, 1000 * seed + 500 + number)


def _drifted(world: World, seed: int) -> World:
    """A field after one more step of its walk; truth and the first feature are the same quantity."""
    field, grid = world.field, world.field.environment.grid
    generator = np.random.default_rng(seed)
    steps = []
    for index in range(field.ssv.shape[1]):
        smooth = gaussian_filter(generator.normal(size=(grid.rows, grid.columns)), DRIFT_CELLS)
        steps.append((smooth / smooth.std() * DRIFT * np.nanstd(field.ssv[:, index])).ravel())
    truth = field.environment.truth
    assert truth is not None  # fields of benchmarks have it
    environment = replace(field.environment, truth=truth + steps[0].reshape(grid.rows, grid.columns))
    return replace(world, field=replace(field, environment=environment, ssv=field.ssv + np.column_stack(steps)))


def campaign(worlds: Sequence[World], first: dict[str, SAModel], arm: Arm, seed: int) -> Campaign:
    """All missions of one fleet."""
    models = {INITIAL: first[INITIAL]}
    weights = first_weights(AGENTS)
    history, useful, result = History(), list[Mapping[str, float | None]](), Campaign()
    for number, world in enumerate(worlds, 1):
        outcome = world.fly(weights, models, log=True)
        _note(result, outcome, weights)
        if arm.learner is None:
            continue
        losses = {agent: outcome.believed.of(outcome.efforts[agent]) for agent in AGENTS}
        seen = tuple(Observation(number, agent, weights[agent], losses[agent]) for agent in AGENTS)
        history = History(history.observations + seen)
        learning = OnlineLearning(weights=arm.learner)
        before, models = models, first | models
        wanted = arm.retrained(useful)
        for subset in wanted:
            start = before.get(subset.key, first[INITIAL])
            models[subset.key] = retrain(start, outcome.logs, subset, world.reward, learning.retraining, seed + number)[
                0
            ]
        result.retrained.append(len(wanted))
        replayer = _replayer(world, outcome, weights, (before, models))
        weights = propose_weights(history, list(models), AGENTS, learning, seed, replayer)
        useful.append(usefulness(weights, list(models), history.flown))
    return result


def _note(result: Campaign, outcome: Outcome, weights: Mapping[str, Mapping[str, float]]) -> None:
    result.losses.append(outcome.smooth)
    result.accuracies.append(outcome.accuracy)
    result.largest.append(float(np.mean([max(own.values()) for own in weights.values()])))
    for key in (USELESS, HARMFUL):
        result.given[key].append(float(np.mean([own.get(key, 0.0) for own in weights.values()])))


def _replayer(
    world: World,
    outcome: Outcome,
    weights: Mapping[str, Mapping[str, float]],
    models: tuple[Mapping[str, SAModel], Mapping[str, SAModel]],
) -> Replayer:
    """Replays a mission with the models that flew, and with the next ones."""
    belief = believed_ssv(world.field.environment.grid, outcome.logs)
    return Replayer(
        world.field.layout, AGENTS, belief, weights, *models, world.reward, ENERGY, outcome.believed, outcome.efforts
    )


def planted(worlds: Sequence[World], seed: int) -> dict[str, SAModel]:
    """A useless and a harmful model: of random models by their loss on the first, middle and last day."""
    generator = np.random.default_rng(seed)
    blank = QLearning.blank(SASpec(), FEATURES, worlds[0].reward.normaliser, seed)
    chance = [replace(blank, weights=generator.normal(size=blank.weights.shape)) for _ in range(RANDOM)]
    days = (worlds[0], worlds[len(worlds) // 2], worlds[-1])
    order = np.argsort([sum(alone(day, model).smooth for day in days) for model in chance], kind="stable")
    return {USELESS: chance[order[-2]], HARMFUL: chance[order[-1]]}


Case = tuple[str, float, int, int, tuple[str, ...]]
"""A field, a goal's tightness, a seed, a number of missions, and the arms."""


def measure(case: Case) -> dict[str, Campaign]:
    """All missions of all arms."""
    name, tightness, seed, missions, arms = case
    pairs = [world_of(each, seed, DATA) for each in (DATES if name == "corn-dates" else (name,))]
    start, known = pairs[0]
    first: dict[str, SAModel] = {INITIAL: trained(known.field, start.reward, seed)}
    worlds = []
    for world, _ in pairs:
        today = replace(world, reward=start.reward)
        worlds.append(replace(today, objective=objective(alone(today, first[INITIAL]).accuracy + tightness)))
    flown = list(drifting(worlds, missions, seed))
    first |= planted(flown, seed)
    return {arm: campaign(flown, first, ARMS[arm], seed) for arm in arms}


Cases = Sequence[Mapping[str, Campaign]]


def after_first(cases: Cases, arm: str) -> NDArray[np.float64]:
    """Mean loss of the missions after the first, of each case."""
    return np.array([np.mean(case[arm].losses[1:]) for case in cases])


def trend(cases: Cases, arm: str) -> NDArray[np.float64]:
    """How much more is won over the first model alone in the last three missions than in missions 2 to 4."""
    won = np.array([np.subtract(case[arm].losses, case[FIRST_ALONE].losses) for case in cases])
    return np.asarray(won[:, -3:].mean(axis=1) - won[:, 1:4].mean(axis=1))


def report(title: str, cases: Cases) -> None:
    """Print the arms over some cases."""
    print(f"== {title}: {len(cases)} campaigns; differences of the mean loss of missions 2 to the last")
    arms = list(cases[0])
    for arm in arms:
        mine = after_first(cases, arm)
        rivals = {"first": FIRST_ALONE, "EI": EI.value, "best": BEST.value, "no work left out": ARMS[arm].plain}
        gains = [
            f"to {short} {paired(mine, after_first(cases, name))}"
            for short, name in rivals.items()
            if name in arms and name != arm
        ]
        late = {key: np.mean([case[arm].given[key][-3:] for case in cases]) for key in (USELESS, HARMFUL)}
        largest = np.mean([case[arm].largest[-3:] for case in cases])
        work = np.mean([sum(case[arm].retrained) for case in cases])
        print(
            f"{arm}: {'; '.join(gains)}; trend {interval(trend(cases, arm))}; in the last three missions useless "
            f"{late[USELESS]:.3f}, harmful {late[HARMFUL]:.3f}, largest {largest:.2f}; {work:.0f} retrainings",
            flush=True,
        )


def run() -> list[Result]:
    """The short form for `make bench`: one drifting field, real where the data is there."""
    name = DATES[0] if (DATA / "corn-cube").is_dir() else "synthetic"
    arms = tuple(arm.name for arm in LEARNERS)
    cases = [measure((name, tightness, seed, 6, arms)) for tightness in TIGHTNESS for seed in range(3)]
    command = f"python -m bench.weights --seeds 3 --missions 6 --fields {name} --arms {' '.join(map(repr, arms))}"
    first = (FIRST_ALONE, float(after_first(cases, FIRST_ALONE).mean()))
    losses = {each: float(after_first(cases, each.value).mean()) for each in (EI, UNIFORM, HEDGE, BEST)}
    return [
        Result.against(f"mission loss by {each.value}", loss, "loss", first, command) for each, loss in losses.items()
    ]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--missions", type=int, default=10)
    parser.add_argument("--fields", nargs="+", default=FIELDS)
    parser.add_argument("--arms", nargs="+", default=list(ARMS), choices=list(ARMS))
    parser.add_argument("--processes", type=int, default=1)
    arguments = parser.parse_args()
    arms = tuple(dict.fromkeys([FIRST_ALONE, *arguments.arms]))
    whole: list[dict[str, Campaign]] = []
    with ProcessPoolExecutor(arguments.processes) as pool:
        for name in arguments.fields:
            for tightness in TIGHTNESS:
                cases = [(name, tightness, seed, arguments.missions, arms) for seed in range(arguments.seeds)]
                found = list(pool.map(measure, cases))
                report(f"{name}, goal {tightness:+.2f}", found)
                whole += found
    report("all", whole)
    OUT.parent.mkdir(exist_ok=True)
    OUT.write_text(json.dumps([{arm: asdict(each) for arm, each in case.items()} for case in whole]), encoding="utf-8")


if __name__ == "__main__":
    main()

"""Does learning between missions bring the paper's swarm nearer to its goal?

    python -m bench.scouting.online [--short] [--seeds 10] [--fields ...] [--goals ...] [--missions 10] [--workers 2]

Four agents that have learned on other fields for a goal (`bench.scouting.lessons`) fly a field ten times, while it
drifts (`bench.weights`: a fifth of a deviation from mission to mission, and some noise). After each mission the models
of all subsets of the agents are retrained, and each agent's weights over them are found anew: by expected improvement
as in the paper, or by multiplicative weights, the platform's default. Beside them the first model flies on alone. The
fields and seeds are the same, so differences are paired. Maps are made by the neighbour mean.

Printed for each goal: accuracy of the first and of the last mission; how much more it rose than without learning, and
by what share the error (1 - accuracy) fell more, with 95 % intervals over the seeds.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.missions import Field, World, objective
from bench.scouting.campaign import known
from bench.scouting.fields import NAMES, REAL, averaged_over
from bench.scouting.lessons import QUICK, Course, Learned, learn, quantities
from bench.scouting.results import write as write_results
from bench.statistics import interval
from bench.weights import Arm, campaign, drifting
from fleet.learning.model import SAModel
from fleet.learning.qlearning import QLearning
from fleet.learning.reward import Normaliser
from fleet.missions.documents import INITIAL
from fleet.spec.learning import WeightLearner

OUT = Path(__file__).resolve().parents[1] / "out" / "online.json"
Values = NDArray[np.float64]
GOALS = (0.75, 0.8, 0.85, 0.9, 0.95)
AGENTS, MISSIONS = 4, 10
WITHOUT = Arm(None)
ARMS = (WITHOUT, Arm(WeightLearner.EXPECTED_IMPROVEMENT), Arm(WeightLearner.MULTIPLICATIVE_WEIGHTS))
Accuracies = Mapping[str, Sequence[float]]
"""Accuracy of each mission, by arm."""


def campaigns(case: tuple[Course, int]) -> Accuracies:
    """All arms over a drifting field, (what is learned first, how many missions)."""
    course, missions = case
    learned = learn(course)
    world, model = in_units(course, learned)
    worlds = list(drifting([world], missions, course.seed))
    return {arm.name: campaign(worlds, {INITIAL: model}, arm, course.seed).accuracies for arm in ARMS}


def in_units(course: Course, learned: Learned) -> tuple[World, SAModel]:
    """The field with its SSVs in their own units, and SA likewise.

    What was learned refers to standard deviations from the mean; in the flown field's units it is the same function,
    with other bounds of the normaliser.
    """
    terrain = learned.terrain
    ssv = quantities(known(course.field, 0), terrain.features)
    mean, deviation = np.nanmean(ssv, axis=0), np.nanstd(ssv, axis=0)

    def moved(normaliser: Normaliser) -> Normaliser:
        low, high = (np.array(bound) * deviation + mean for bound in (normaliser.low, normaliser.high))
        return Normaliser(low=tuple(low.tolist()), high=tuple(high.tolist()))

    if not isinstance(learned.model, QLearning):
        raise TypeError(f"SA is {learned.model.kind}; campaigns are flown with Q-learning")
    reward = learned.reward.model_copy(update={"normaliser": moved(learned.reward.normaliser)})
    model = replace(learned.model, normaliser=moved(learned.model.normaliser))
    return World(Field(terrain.environment, terrain.layout, ssv), reward, objective(course.goal)), model


def show(found: Mapping[Course, Accuracies], console: Console) -> None:
    """Print a table of the fields of the aims together, and of each other field."""
    names = list(dict.fromkeys(course.field for course in found))
    over = averaged_over(names)
    for some in (over, *([name] for name in names if name not in over)):
        console.print(table({course: each for course, each in found.items() if course.field in some}))


def table(found: Mapping[Course, Accuracies]) -> Table:
    """One row for each goal and arm, means over the fields."""
    result = Table(
        "goal", "learner", "accuracy, first", "last", "rose by, points", "minus without, points",
        "error fell by, minus without, %", "|goal - last|, points",
        title=", ".join(dict.fromkeys(course.field for course in found)),
    )  # fmt: skip
    for goal in sorted({course.goal for course in found}):
        plain = curves(found, goal, WITHOUT.name)
        for arm in ARMS:
            mine = curves(found, goal, arm.name)
            rise, fall = (of(mine) - of(plain) for of in (_rise, _fall))
            away = np.abs(goal - mine[..., -1]).mean()
            result.add_row(
                f"{goal:.0%}", arm.name, f"{100 * mine[..., 0].mean():.1f}", f"{100 * mine[..., -1].mean():.1f}",
                f"{100 * _rise(mine).mean():+.1f}", *("" if arm is WITHOUT else _text(each) for each in (rise, fall)),
                f"{100 * away:.1f}",
            )  # fmt: skip
    return result


def curves(found: Mapping[Course, Accuracies], goal: float, arm: str) -> Values:
    """Accuracy of every mission, float64 [fields, seeds, missions]."""
    mine = {(course.field, course.seed): each[arm] for course, each in found.items() if course.goal == goal}
    names, seeds = (list(dict.fromkeys(part)) for part in zip(*mine, strict=True))
    return np.array([[mine[name, seed] for seed in seeds] for name in names])


def _rise(accuracy: Values) -> Values:
    """Last minus first mission, mean of the fields, [seeds]."""
    return np.asarray((accuracy[..., -1] - accuracy[..., 0]).mean(axis=0))


def _fall(accuracy: Values) -> Values:
    """By what share the mean error of the fields fell, [seeds]."""
    error = (1.0 - accuracy).mean(axis=0)
    return np.asarray(1.0 - error[:, -1] / error[:, 0])


def _text(values: Values) -> str:
    found = interval(values)
    return f"{100 * found.mean:+.1f} [{100 * found.low:+.1f}, {100 * found.high:+.1f}]"


def measured(courses: Sequence[Course], missions: int, workers: int) -> dict[Course, Accuracies]:
    """Learn and fly all campaigns."""
    with ProcessPoolExecutor(workers) as pool:
        flown = pool.map(campaigns, [(course, missions) for course in courses])
        return dict(zip(courses, flown, strict=True))


def write(path: Path, found: Mapping[Course, Accuracies], command: str) -> None:
    """Write every mission's accuracy."""
    runs = [{"field": c.field, "goal": c.goal, "seed": c.seed, "accuracy": dict(each)} for c, each in found.items()]
    write_results(path, command, {"runs": runs})


def read(path: Path) -> dict[Course, Accuracies]:
    """What `write` wrote."""
    runs = json.loads(path.read_text(encoding="utf-8"))["runs"]
    return {Course(run["field"], AGENTS, run["goal"], seed=run["seed"]): run["accuracy"] for run in runs}


def main() -> None:
    """Learn, fly, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="2 seeds, 3 goals, 5 missions, quick learning")
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--fields", nargs="+", choices=NAMES, default=list(REAL))
    parser.add_argument("--goals", nargs="+", type=float)
    parser.add_argument("--missions", type=int)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    short = arguments.short
    seeds = range(arguments.seeds or (2 if short else 10))
    courses = [
        Course(name, AGENTS, goal, seed=seed, settings=QUICK if short else {})
        for goal in arguments.goals or (GOALS[::2] if short else GOALS)
        for name in arguments.fields
        for seed in seeds
    ]
    found = measured(courses, arguments.missions or (5 if short else MISSIONS), arguments.workers)
    write(arguments.out, found, " ".join(["python", *sys.orig_argv[1:]]))
    show(found, Console(width=None if sys.stdout.isatty() else 160))


if __name__ == "__main__":
    main()

"""What does each part of the paper's swarm bring, on fields that it has not seen?

    python -m bench.scouting.paper [--short] [--seeds 10] [--fields ...] [--goals 0.7 0.8 0.9] [--agents 1 2 4 8]
        [--workers 2]

The paper's swarm learns reward, thresholds and SA on other fields (`bench.scouting.lessons`) for a goal, with maps by
the paper's neighbour mean, and flies until all groups are explored. Beside it flies what is left without a part
(`bench.scouting.scaffold`), with the same seeds. Printed: what the mission reached when it ended (also with a kriged
map), and paired differences to it with 95 % intervals, in the mean over the fields. `python -m bench.scouting.online`
has the part that is learned between missions.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.scouting.fields import AIMED, NAMES
from bench.scouting.lessons import Course
from bench.scouting.scaffold import Arm, Outcome, arms
from bench.statistics import paired

OUT = Path(__file__).resolve().parents[1] / "out" / "paper.json"
Values = NDArray[np.float64]
GOALS = (0.7, 0.8, 0.9)
SIZES = (1, 2, 4, 8)
QUICK: Mapping[str, object] = {
    "rewardShaping": {"epochs": 16, "missions": 64},
    "training": {"epochs": 2, "missions": 128},
}
"""A FleetSpec's settings for the short form."""


@dataclass(frozen=True)
class Results:
    """What came of each course: its arms, and the sweep with its moves."""

    arms: dict[Course, dict[Arm, Outcome]] = field(default_factory=dict)
    sweeps: dict[Course, list[Outcome]] = field(default_factory=dict)

    def flown(self, agents: int) -> list[Arm]:
        """The arms that flew with so many agents."""
        first = next(found for course, found in self.arms.items() if course.agents == agents)
        return [arm for arm in Arm if arm in first]

    def figures(self, arm: Arm, goal: float, agents: int, figure: str) -> Values:
        """One figure of an arm, float64 [fields, seeds]."""
        mine = [course for course in self.arms if (course.goal, course.agents) == (goal, agents)]
        names, seeds = (list(dict.fromkeys(part)) for part in zip(*((c.field, c.seed) for c in mine), strict=True))
        values = {(course.field, course.seed): getattr(self.arms[course][arm], figure) for course in mine}
        return np.array([[values[name, seed] for seed in seeds] for name in names])


def measured(courses: Sequence[Course], workers: int) -> Results:
    """Learn and fly all."""
    start, found = time.perf_counter(), {}
    with ProcessPoolExecutor(workers) as pool:
        asked = {pool.submit(arms, course): course for course in courses}
        for answer in as_completed(asked):
            found[asked[answer]] = answer.result()
            if len(found) % 10 == 0:
                print(f"{len(found)} of {len(courses)}, {time.perf_counter() - start:.0f} s", file=sys.stderr)
    return Results({course: found[course][0] for course in courses}, {course: found[course][1] for course in courses})


def of_arms(results: Results, goal: float, agents: int) -> Table:
    """What each arm reached at its end, and its difference to the paper's."""
    table = Table(
        "arm", "accuracy nm/kr", "goal met", "cells", "E", "time, s", "slowest/mean", "nm - paper's, points",
        "kr - paper's, points", "E - paper's, hundredths", title=f"goal {goal:.0%}, {agents} agents",
    )  # fmt: skip
    for arm in results.flown(agents):
        nm, kr, cells, energy, time_s, balance = (
            results.figures(arm, goal, agents, name) for name in ("nm", "kr", "cells", "energy", "time_s", "balance")
        )
        table.add_row(
            arm.value,
            f"{100 * nm.mean():.1f} / {100 * kr.mean():.1f}",
            f"{(nm >= goal).mean():.0%}",
            f"{cells.mean():.0%}",
            f"{energy.mean():.3f}",
            f"{time_s.mean():.0f}",
            f"{balance.mean():.2f}",
            *("" if arm is Arm.PAPER else _difference(results, arm, goal, agents, name) for name in COMPARED),
        )
    return table


COMPARED = ("nm", "kr", "energy")


def _difference(results: Results, arm: Arm, goal: float, agents: int, figure: str) -> str:
    ours, theirs = (results.figures(each, goal, agents, figure).mean(axis=0) for each in (arm, Arm.PAPER))
    found = paired(ours, theirs)
    return f"{100 * found.mean:+.1f} [{100 * found.low:+.1f}, {100 * found.high:+.1f}]"


def of_fields(results: Results, goal: float, agents: int) -> Table:
    """What the paper's swarm reached on each field."""
    table = Table(
        "field", "accuracy nm/kr", "goal met", "cells", "E", "random moves: nm", "E ", title=f"goal {goal:.0%}"
    )
    names = list(dict.fromkeys(course.field for course in results.arms))
    nm, kr, cells, energy = (results.figures(Arm.PAPER, goal, agents, name) for name in ("nm", "kr", "cells", "energy"))
    random_nm, random_e = (results.figures(Arm.RANDOM_MOVES, goal, agents, name) for name in ("nm", "energy"))
    for index, name in enumerate(names):
        table.add_row(
            name,
            f"{100 * nm[index].mean():.1f} / {100 * kr[index].mean():.1f}",
            f"{(nm[index] >= goal).mean():.0%}",
            f"{cells[index].mean():.0%}",
            f"{energy[index].mean():.3f}",
            f"{100 * random_nm[index].mean():.1f}",
            f"{random_e[index].mean():.3f}",
        )
    return table


def of_sizes(results: Results, goal: float) -> Table:
    """One agent's time and energy over those of several, of the paper's swarm."""
    sizes = sorted({course.agents for course in results.arms})
    table = Table(
        "agents", "sooner", "energy", "slowest/mean", "accuracy nm", title=f"goal {goal:.0%}: 1 agent over several"
    )
    one_s, one_e = (results.figures(Arm.PAPER, goal, sizes[0], name).mean(axis=1) for name in ("time_s", "energy"))
    for size in sizes:
        time_s, energy, balance, nm = (
            results.figures(Arm.PAPER, goal, size, name).mean(axis=1) for name in ("time_s", "energy", "balance", "nm")
        )
        table.add_row(
            str(size), f"{(one_s / time_s).mean():.2f}", f"{(energy / one_e).mean():.2f}", f"{balance.mean():.2f}",
            f"{100 * nm.mean():.1f}",
        )  # fmt: skip
    return table


def write(path: Path, results: Results, command: str) -> None:
    """Write every outcome."""
    runs = [
        {
            "field": course.field, "agents": course.agents, "goal": course.goal, "seed": course.seed,
            "arms": {arm.value: outcome._asdict() for arm, outcome in found.items()},
            "sweep": [outcome._asdict() for outcome in results.sweeps[course]],
        }
        for course, found in results.arms.items()
    ]  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"command": command, "runs": runs}) + "\n", encoding="utf-8")


def read(path: Path) -> Results:
    """What `write` wrote."""
    results = Results()
    for run in json.loads(path.read_text(encoding="utf-8"))["runs"]:
        course = Course(run["field"], run["agents"], run["goal"], seed=run["seed"])
        results.arms[course] = {Arm(arm): Outcome(**figures) for arm, figures in run["arms"].items()}
        results.sweeps[course] = [Outcome(**figures) for figures in run["sweep"]]
    return results


def main() -> None:
    """Learn, fly, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="2 seeds, 4 agents, goals 70 and 90 %%, quick learning")
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--fields", nargs="+", choices=NAMES, default=list(AIMED))
    parser.add_argument("--goals", nargs="+", type=float)
    parser.add_argument("--agents", nargs="+", type=int)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    short = arguments.short
    goals, sizes = arguments.goals or (GOALS[::2] if short else GOALS), arguments.agents or ((4,) if short else SIZES)
    seeds = range(arguments.seeds or (2 if short else 10))
    courses = [
        Course(name, size, goal, seed=seed, settings=QUICK if short else {})
        for goal in goals for size in sizes for name in arguments.fields for seed in seeds
    ]  # fmt: skip
    results = measured(courses, arguments.workers)
    command = " ".join(["python", *sys.orig_argv[1:]])
    write(arguments.out, results, command)
    show(results, Console(width=None if sys.stdout.isatty() else 200))
    print(f"{len(courses)} courses in {arguments.out}; {command}")


def show(results: Results, console: Console) -> None:
    """Print every table."""
    goals, sizes = (sorted({getattr(course, name) for course in results.arms}) for name in ("goal", "agents"))
    most = 4 if 4 in sizes else sizes[-1]
    for goal in goals:
        for size in sizes:
            console.print(of_arms(results, goal, size))
        console.print(of_fields(results, goal, most))
        if len(sizes) > 1:
            console.print(of_sizes(results, goal))


if __name__ == "__main__":
    main()

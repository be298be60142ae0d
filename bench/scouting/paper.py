"""What does each part of the paper's swarm bring, on fields that it has not seen?

    python -m bench.scouting.paper [--short] [--seeds 10] [--fields ...] [--goals 0.7 0.8 0.9] [--agents 1 2 4 8]
        [--hows nm kr] [--workers 2]

The paper's swarm learns reward, thresholds and SA on other fields (`bench.scouting.lessons`) for a goal, and flies
until all groups are explored. Its Eval() makes maps by the paper's neighbour mean, and once more, with 4 agents, by
kriging: reward and thresholds are shaped for that map. Other numbers of agents fly for 70 and 90 %. Beside it flies
what is left without a part (`bench.scouting.scaffold`), with the same seeds. Printed: what the mission reached when it
ended, by both maps, and paired differences to it with 95 % intervals, in the mean over the fields of the aims, and for
every field. `python -m bench.scouting.online` has the part that is learned between missions.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from json import loads
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from bench.scouting import paper_plots, paper_tables
from bench.scouting.fields import NAMES, REAL
from bench.scouting.judge import How
from bench.scouting.lessons import QUICK, Course
from bench.scouting.results import write as write_results
from bench.scouting.scaffold import WEIGHED_AT, Arm, Outcome, arms

OUT = Path(__file__).resolve().parents[1] / "out" / "paper.json"
Values = NDArray[np.float64]
GOALS = (0.7, 0.8, 0.9)
SIZES = (1, 2, 4, 8)
SIZED_AT = (0.7, 0.9)
"""Goals for which other numbers of agents than WEIGHED_AT fly, where no numbers are asked for."""
HOWS = (How.NM, How.KR)


@dataclass(frozen=True)
class Results:
    """What came of each course: its arms, and the sweep with its moves."""

    arms: dict[Course, dict[Arm, Outcome]] = field(default_factory=dict)
    sweeps: dict[Course, list[Outcome]] = field(default_factory=dict)

    @property
    def fields(self) -> list[str]:
        """Names, in the order of the courses."""
        return list(dict.fromkeys(course.field for course in self.arms))

    @property
    def goals(self) -> list[float]:
        """Ascending."""
        return sorted({course.goal for course in self.arms})

    @property
    def sizes(self) -> list[int]:
        """Numbers of agents, ascending."""
        return sorted({course.agents for course in self.arms})

    @property
    def hows(self) -> list[How]:
        """By what maps was shaped, in the order of the courses."""
        return list(dict.fromkeys(course.how for course in self.arms))

    def shaped_by(self, how: How) -> Results:
        """Those whose reward was shaped by one kind of map."""
        return self._of([course for course in self.arms if course.how is how])

    def to(self, goal: float) -> Results:
        """Those for one goal."""
        return self._of([course for course in self.arms if course.goal == goal])

    def on(self, names: Sequence[str]) -> Results:
        """Those over some fields."""
        return self._of([course for course in self.arms if course.field in names])

    def _of(self, wanted: Sequence[Course]) -> Results:
        return Results({each: self.arms[each] for each in wanted}, {each: self.sweeps[each] for each in wanted})

    def flown(self, agents: int) -> list[Arm]:
        """The arms that flew with so many agents."""
        first = next(found for course, found in self.arms.items() if course.agents == agents)
        return [arm for arm in Arm if arm in first]

    def figures(self, arm: Arm, goal: float, agents: int, figure: str) -> Values:
        """One figure of an arm, float64 [fields, seeds]; of results that were shaped by one kind of map."""
        mine = [course for course in self.arms if (course.goal, course.agents) == (goal, agents)]
        names, seeds = (list(dict.fromkeys(part)) for part in zip(*((c.field, c.seed) for c in mine), strict=True))
        values = {(course.field, course.seed): getattr(self.arms[course][arm], figure) for course in mine}
        return np.array([[values[name, seed] for seed in seeds] for name in names])


def courses(arguments: argparse.Namespace) -> list[Course]:
    """All that is learned and flown."""
    short = arguments.short
    goals, sizes = arguments.goals or (GOALS[::2] if short else GOALS), arguments.agents or ((4,) if short else SIZES)
    seeds, settings = range(arguments.seeds or (2 if short else 10)), QUICK if short else {}

    def is_flown(how: How, goal: float, size: int) -> bool:
        return size == WEIGHED_AT or (how is How.NM and (goal in SIZED_AT or arguments.agents is not None))

    return [
        Course(name, size, goal, how, seed, settings)
        for how in arguments.hows for goal in goals for size in sizes if is_flown(how, goal, size)
        for name in arguments.fields for seed in seeds
    ]  # fmt: skip


def measured(wanted: Sequence[Course], workers: int) -> Results:
    """Learn and fly all."""
    start, found = time.perf_counter(), {}
    with ProcessPoolExecutor(workers) as pool:
        asked = {pool.submit(arms, course): course for course in wanted}
        for answer in as_completed(asked):
            found[asked[answer]] = answer.result()
            if len(found) % 10 == 0:
                print(f"{len(found)} of {len(wanted)}, {time.perf_counter() - start:.0f} s", file=sys.stderr)
    return Results({course: found[course][0] for course in wanted}, {course: found[course][1] for course in wanted})


def write(path: Path, results: Results, command: str) -> None:
    """Write every outcome."""
    runs = [
        {
            "field": course.field, "agents": course.agents, "goal": course.goal, "how": course.how.value,
            "seed": course.seed, "arms": {arm.value: outcome._asdict() for arm, outcome in found.items()},
            "sweep": [outcome._asdict() for outcome in results.sweeps[course]],
        }
        for course, found in results.arms.items()
    ]  # fmt: skip
    write_results(path, command, {"runs": runs})


def read(path: Path) -> Results:
    """What `write` wrote."""
    results = Results()
    for run in loads(path.read_text(encoding="utf-8"))["runs"]:
        course = Course(run["field"], run["agents"], run["goal"], How(run["how"]), run["seed"])
        results.arms[course] = {Arm(arm): Outcome(**figures) for arm, figures in run["arms"].items()}
        results.sweeps[course] = [Outcome(**figures) for figures in run["sweep"]]
    return results


def main() -> None:
    """Learn, fly, print, draw and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="2 seeds, 4 agents, goals 70 and 90 %%, quick learning")
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--fields", nargs="+", choices=NAMES, default=list(REAL))
    parser.add_argument("--goals", nargs="+", type=float)
    parser.add_argument("--agents", nargs="+", type=int)
    parser.add_argument("--hows", nargs="+", type=How, choices=HOWS, default=list(HOWS), help="maps that Eval() makes")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    wanted = courses(arguments)
    results = measured(wanted, arguments.workers)
    command = " ".join(["python", *sys.orig_argv[1:]])
    write(arguments.out, results, command)
    paper_plots.draw(results, arguments.out.with_suffix(".png"))
    paper_tables.show(results, Console(width=None if sys.stdout.isatty() else 200))
    print(f"{len(wanted)} courses in {arguments.out}, and a picture beside it; {command}")


if __name__ == "__main__":
    main()

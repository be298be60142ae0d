"""The paper's headline figures for crop scouting, measured with our code.

    python -m bench.scouting.headlines [--short] [--seeds 10] [--fields ...] [--workers 2]
        [--paper bench/out/paper.json] [--online bench/out/online.json] [--no-online]

Missions of `python -m bench.scouting.paper` and of `python -m bench.scouting.online` are read from their files where
these are given, and else flown here. Two swarms are measured: the paper's, with what it learned on other fields, and
the planned one. They and the rivals (Classic RL, and row by row, which the paper calls automated) land when their map
meets the goal. Means over the four fields of the aims, and over the others, of those on which both reach it; 95 %
intervals over the seeds. The paper's swarm is the one whose reward was shaped by the neighbour mean. In the paper
aircraft hover until the next move is decided; with the platform they may decide while they fly. Both are printed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.scouting import online, paper
from bench.scouting.campaign import known
from bench.scouting.ends import Spent, ends
from bench.scouting.fields import NAMES, REAL, Field, averaged_over
from bench.scouting.flight import thorough_j
from bench.scouting.hover import WAIT_S, classic, planned
from bench.scouting.judge import How
from bench.scouting.lessons import QUICK, Course
from bench.scouting.results import write
from bench.scouting.rivals.lines import Lawnmower
from bench.scouting.scaffold import Arm, at
from bench.statistics import interval

Values = NDArray[np.float64]
GOALS = (0.7, 0.9)
SIZES = (1, 2, 4)
HOWS = (How.NM, How.KR)
PLANNED, PAPER, CLASSIC, LAWNMOWER = "planned", "paper's", "k-NN Classic RL", "lawnmower"
OURS = (PAPER, PLANNED)
_FIGURES = ("cells", "energy", "time")


OUT = Path(__file__).resolve().parents[1] / "out" / "headlines.json"


@dataclass(frozen=True, order=True)
class Case:
    """Missions of a swarm that end at a goal.

    Args:
        swarm: Whose.
        agents: How many fly.
        goal: Accuracy.
        hovering: Whether aircraft hover for each decision.
        how: From captured cells to a map.
    """

    swarm: str
    agents: int
    goal: float
    hovering: bool
    how: How


Tally = Mapping[Case, Values]
"""What each case spent, float64 [fields, seeds, 3]."""


def spent(job: tuple[str, int]) -> dict[Case, Spent]:
    """What all swarms but the paper's spend on a field with a seed."""
    name, seed = job
    place, found = known(name, 0), dict[Case, Spent]()
    for agents in SIZES:
        missions = {
            (swarm, hovering): fly(place, agents, seed, WAIT_S * hovering).flights
            for swarm, fly in ((PLANNED, planned), (CLASSIC, classic))
            for hovering in (False, True)
        }
        lines = Lawnmower().fly(place, agents, seed, None)
        missions |= {(LAWNMOWER, hovering): lines for hovering in (False, True)}
        for (swarm, hovering), flights in missions.items():
            for (goal, how), (cells, energy, time_s) in ends(place, flights, GOALS, HOWS).items():
                case = Case(swarm, agents, goal, hovering, how)
                found[case] = cells, energy * thorough_j(place, agents), time_s
    return found


def spent_in_scaffold(results: paper.Results, place: Field, seed: int) -> dict[Case, Spent]:
    """What the paper's swarm spends: captured cells of a group between those of two missions of its sweep."""
    found = dict[Case, Spent]()
    for course, sweep in results.sweeps.items():
        if (course.field, course.seed) == (place.name, seed) and course.goal in GOALS and course.agents in SIZES:
            for how in HOWS:
                end = at(sweep, how.value, course.goal)
                for hovering in (False, True):
                    energy, time_s = end.energy + hovering * end.hover_energy, end.time_s + hovering * end.hover_s
                    case = Case(PAPER, course.agents, course.goal, hovering, how)
                    found[case] = end.cells, energy * thorough_j(place, course.agents), time_s
    return found


def tally(results: paper.Results, names: Sequence[str], seeds: Sequence[int], workers: int) -> Tally:
    """Fly what is not known yet, and put all together."""
    jobs = [(name, seed) for name in names for seed in seeds]
    with ProcessPoolExecutor(workers) as pool:
        rows = [
            each | spent_in_scaffold(results, known(*job[:1], 0), job[1])
            for job, each in zip(jobs, pool.map(spent, jobs), strict=True)
        ]
    shape = (len(names), len(seeds), len(_FIGURES))
    return {case: np.array([row[case] for row in rows]).reshape(shape) for case in rows[0]}


def ratio(found: Tally, ours: Case, theirs: Case, figure: str) -> Values:
    """Theirs over ours, the mean of the fields, float64 [seeds]."""
    column = _FIGURES.index(figure)
    return np.asarray(np.nanmean(found[theirs][..., column] / found[ours][..., column], axis=0))


def cells(found: Tally, case: Case) -> Values:
    """Share of the cells, mean of the fields, float64 [seeds]."""
    return np.asarray(np.nanmean(found[case][..., 0], axis=0))


def figures(found: Tally, hovering: bool, how: How, where: str = "") -> Table:
    """The paper's figures beside ours."""
    what = "hovering for decisions" if hovering else "deciding in flight"
    table = Table("figure", "published", *OURS, title=f"{what}; map by {how}; {where}")

    def case(swarm: str, agents: int, goal: float) -> Case:
        return Case(swarm, agents, goal, hovering, how)

    def row(name: str, published: str, of: Mapping[str, Values], percent: bool = False) -> None:
        table.add_row(name, published, *(text(of[swarm], percent) for swarm in OURS))

    low = {swarm: case(swarm, 4, 0.7) for swarm in OURS}
    row("cells for 70 %", "26 %", {swarm: cells(found, each) for swarm, each in low.items()}, percent=True)
    for rival, published in ((CLASSIC, "1.73"), (LAWNMOWER, "2.2")):
        of = {swarm: ratio(found, each, case(rival, 4, 0.7), "cells") for swarm, each in low.items()}
        row(f"cells for 70 %: {rival} / ours", published, of)
    for goal in GOALS:
        title = f"{goal:.0%}: {CLASSIC}"
        for figure, published in (("time", "1.1 - 4 (10 - 75 % shorter)"), ("energy", "1.58 - 2")):
            for agents in SIZES:
                of = {s: ratio(found, case(s, agents, goal), case(CLASSIC, agents, goal), figure) for s in OURS}
                row(f"{figure} to {title} / ours, {agents} each", published, of)
        one = case(CLASSIC, 1, goal)
        of = {swarm: ratio(found, case(swarm, 4, goal), one, "time") for swarm in OURS}
        row(f"time to {title}, 1 / ours, 4", "3.9 - 4.4", of)
        of = {swarm: ratio(found, case(swarm, 4, goal), one, "energy") for swarm in OURS}
        row(f"energy to {title}, 1 / ours, 4: all aircraft", "", of)
        row(f"energy to {title}, 1 / ours, 4: of one aircraft", "3.7 - 3.9", {s: 4 * of[s] for s in OURS})
        of = {swarm: ratio(found, case(swarm, 4, goal), case(swarm, 1, goal), "time") for swarm in OURS}
        row(f"time to {goal:.0%}: ours, 1 / ours, 4", "", of)
    return table


def show(found: Tally, names: Sequence[str], console: Console) -> None:
    """Print the figures over the fields of the aims, and over the others."""
    over = averaged_over(names)
    for some in filter(None, (over, [name for name in names if name not in over])):
        part = {case: values[[names.index(name) for name in some]] for case, values in found.items()}
        for how in HOWS:
            for hovering in (True, False):
                console.print(figures(part, hovering, how, ", ".join(some)))


def document(found: Tally, names: Sequence[str]) -> dict[str, object]:
    """What each case spent, for JSON; what is not reached is null."""
    runs = [{**asdict(case), "spent": values.tolist()} for case, values in found.items()]
    return {"fields": list(names), "figures": _FIGURES, "runs": runs}


def text(values: Values, percent: bool = False) -> str:
    """Mean and interval."""
    found = interval(values[np.isfinite(values)])
    if percent:
        return f"{100 * found.mean:.1f} % [{100 * found.low:.1f}, {100 * found.high:.1f}]"
    return f"{found.mean:.2f} [{found.low:.2f}, {found.high:.2f}]"


def by_itself(results: paper.Results) -> Table:
    """Where the paper's missions end by themselves."""
    table = Table(
        "goal",
        "cells",
        "accuracy nm",
        "goal met",
        title="the paper's missions, ended by T_u and T_v; 4 agents; fields of the aims",
    )
    for goal in sorted({course.goal for course in results.arms}):
        share, accuracy = (results.figures(Arm.PAPER, goal, 4, name) for name in ("cells", "nm"))
        met = f"{(accuracy >= goal).mean():.0%}"
        table.add_row(f"{goal:.0%}", text(share.mean(axis=0), True), text(accuracy.mean(axis=0), True), met)
    return table


def main() -> None:
    """Fly or read, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="2 seeds, quick learning, 4 missions")
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--paper", type=Path, help="results of bench.scouting.paper")
    parser.add_argument("--online", type=Path, help="results of bench.scouting.online")
    parser.add_argument("--no-online", action="store_true", help="leave learning between missions out")
    parser.add_argument("--fields", nargs="+", choices=NAMES, default=list(REAL))
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    names, seeds = arguments.fields, range(arguments.seeds or (2 if arguments.short else 10))
    settings = QUICK if arguments.short else {}
    console = Console(width=None if sys.stdout.isatty() else 160)
    results = paper.read(arguments.paper) if arguments.paper else paper.measured(
        [Course(name, size, goal, seed=seed, settings=settings)
         for goal in GOALS for size in SIZES for name in names for seed in seeds], arguments.workers
    )  # fmt: skip
    results = results.shaped_by(How.NM)
    found = tally(results, names, seeds, arguments.workers)
    show(found, names, console)
    console.print(by_itself(results.on(averaged_over(names))))
    write(arguments.out, " ".join(["python", *sys.orig_argv[1:]]), document(found, names))
    if arguments.no_online:
        return
    over = averaged_over(names)
    goals, missions = (GOALS[:1], 4) if arguments.short else (online.GOALS, online.MISSIONS)
    learning = online.read(arguments.online) if arguments.online else online.measured(
        [Course(name, online.AGENTS, goal, seed=seed, settings=settings)
         for goal in goals for name in over for seed in seeds], missions, arguments.workers
    )  # fmt: skip
    console.print("published: accuracy + 1 to 3 points after 10 missions, error 5 to 28 % less")
    online.show(learning, console)


if __name__ == "__main__":
    main()

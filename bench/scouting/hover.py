"""What does it cost to hover until the next move is decided?

    python -m bench.scouting.hover [--seeds 10] [--agents 4] [--workers 2] [--fields ...]

The profile's latencies, from the picture to the decision: sending, features, choice. An aircraft that decides while it
flies pays nothing; printed is what the others pay, as a share of all energy that is spent up to a goal, in the mean
over the missions of the fields of the aims, and of the others.
The planned swarm looks about every third move; in state groups every captured state asks for a move; Classic RL asks
in every cell.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.scouting.campaign import known
from bench.scouting.ends import ends
from bench.scouting.fields import NAMES, REAL, Field, averaged_over
from bench.scouting.flight import ENERGY, Flights, flown, thorough_j
from bench.scouting.judge import How
from bench.scouting.results import write
from bench.scouting.rivals.groups import ClassicRL
from bench.scouting.scaffold import at, sweep, untaught
from fleet.functions.belief import Belief
from fleet.planning.scouting import Scout
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import Tactics

OUT = Path(__file__).resolve().parents[1] / "out" / "hover.json"
Flags = NDArray[np.bool_]
Job = tuple[str, int, int]
"""Field, agents, seed."""
Case = tuple[str, float, How]
"""Swarm, goal, map."""
Share = tuple[float, float]
"""Hovering as a share of all energy, and decisions for each cell that is captured."""
GOALS = (0.7, 0.8)
HOWS = (How.NM, How.KR)
PLANNED, GROUPS, CLASSIC = "planned", "3x3 groups, random moves", "k-NN Classic RL"
WAIT_S = ENERGY.edge.state_s
"""From a picture to the decision, in s."""


@dataclass(frozen=True, eq=False)
class Asking:
    """A mission in which agents hover for decisions.

    Args:
        flights: With the time and energy of hovering.
        asked: In which visits of each flight something was decided, bool [S].
    """

    flights: Flights
    asked: tuple[Flags, ...]

    def decisions(self, until_s: float) -> int:
        """Decisions up to a time."""
        pairs = zip(self.flights, self.asked, strict=True)
        return sum(int(np.count_nonzero(asked[flight.time_s <= until_s])) for flight, asked in pairs)


class Watched(Swarm):
    """A swarm that remembers where each agent looked for its next path."""

    def __init__(self, place: Field, agents: int, seed: int) -> None:
        super().__init__(Belief(place.grid), ENERGY, scattered(place.grid, agents, seed), Tactics())
        self.looks: list[list[int]] = [[] for _ in self.scouts]

    def choose_path(self, scout: Scout) -> tuple[int, ...]:
        """As ever."""
        index = self.scouts.index(scout)
        self.looks[index].append(len(self.traces[index].cells) - 1)
        return super().choose_path(scout)


def planned(place: Field, agents: int, seed: int, wait_s: float = WAIT_S) -> Asking:
    """The planned swarm; each agent hovers where it looks."""
    swarm = Watched(place, agents, seed)
    swarm.fly(lambda cell: float(place.truth[cell]))
    asked = tuple(np.isin(np.arange(len(t.cells)), looks) for t, looks in zip(swarm.traces, swarm.looks, strict=True))
    flights = tuple(
        flown(place.grid, np.array(trace.cells), np.array(trace.captured), wait_s * flags)
        for trace, flags in zip(swarm.traces, asked, strict=True)
    )
    return Asking(flights, asked)


def classic(place: Field, agents: int, seed: int, wait_s: float = WAIT_S) -> Asking:
    """k-NN Classic RL; each agent hovers in every cell that it captures."""
    plain = ClassicRL().fly(place, agents, seed, None)
    flights = tuple(flown(place.grid, each.cells, each.captured, wait_s * each.captured) for each in plain)
    return Asking(flights, tuple(each.captured for each in plain))


def shares(job: Job) -> dict[Case, Share]:
    """What hovering costs over a field, for each swarm, goal and map."""
    name, agents, seed = job
    place, found = known(name, 0), dict[Case, Share]()
    all_j, decision_j = thorough_j(place, agents), WAIT_S * ENERGY.aircraft.hover.power_w
    for swarm, mission in ((PLANNED, planned(place, agents, seed)), (CLASSIC, classic(place, agents, seed))):
        for (goal, how), (cells, energy, time_s) in ends(place, mission.flights, GOALS, HOWS).items():
            decisions = math.nan if math.isnan(energy) else mission.decisions(time_s - mission.flights[0].landing_s)
            share = decisions * decision_j / (energy * all_j)
            found[swarm, goal, how] = share, decisions / (cells * len(place.cells))
    wanderers = sweep(untaught(place, agents), exploration=1.0, seed=seed)
    for goal, how in product(GOALS, HOWS):
        end = at(wanderers, how.value, goal)
        share = end.hover_energy / (end.energy + end.hover_energy)
        found[GROUPS, goal, how] = share, end.hover_energy * all_j / decision_j / (end.cells * len(place.cells))
    return found


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--agents", type=int, default=4)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--fields", nargs="+", choices=NAMES, default=list(REAL))
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    jobs = [(name, arguments.agents, seed) for name in arguments.fields for seed in range(arguments.seeds)]
    with ProcessPoolExecutor(arguments.workers) as pool:
        found = dict(zip(jobs, pool.map(shares, jobs), strict=True))
    over = averaged_over(arguments.fields)
    others = [name for name in arguments.fields if name not in over]
    for names in filter(None, (over, others)):
        Console(width=120).print(table([each for job, each in found.items() if job[0] in names], ", ".join(names)))
    runs = [
        {"field": job[0], "seed": job[2], "swarm": swarm, "goal": goal, "how": how.value,
         "share": share, "decisions": decisions}
        for job, each in found.items() for (swarm, goal, how), (share, decisions) in each.items()
    ]  # fmt: skip
    write(arguments.out, " ".join(["python", *sys.orig_argv[1:]]), {"agents": arguments.agents, "runs": runs})


def table(found: Sequence[Mapping[Case, Share]], title: str) -> Table:
    """One row for each swarm, goal and map, mean over the missions that reach it."""
    result = Table("swarm", "goal", "map by", "hovering, share of the energy", "decisions a captured cell", title=title)
    for swarm, goal, how in found[0]:
        share, decisions = np.nanmean([each[swarm, goal, how] for each in found], axis=0)
        result.add_row(swarm, f"{goal:.0%}", how.value, f"{share:.1%}", f"{decisions:.2f}")
    return result


if __name__ == "__main__":
    main()

"""What does it cost to hover until the next move is decided?

    python -m bench.scouting.hover [--seeds 10] [--agents 4] [--workers 2] [--fields ...]

The profile's latencies, from the picture to the decision: sending, features, choice. An aircraft that decides while it
flies pays nothing; printed is what the others pay, as a share of all energy that is spent up to a goal (kriged map).
The planned swarm looks about every third move; in state groups every captured state asks for a move; Classic RL asks
in every cell.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.scouting.campaign import known
from bench.scouting.fields import AIMED, NAMES, Field
from bench.scouting.flight import ENERGY, Flights, flown, thorough_j
from bench.scouting.judge import How, along, progress
from bench.scouting.rivals.groups import ClassicRL
from bench.scouting.scaffold import at, sweep, untaught
from fleet.functions.belief import Belief
from fleet.planning.scouting import Scout
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import Tactics

Flags = NDArray[np.bool_]
Share = tuple[float, float]
"""Hovering as a share of all energy, and decisions for each cell that is captured."""
GOALS = (0.7, 0.8)
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


def until(place: Field, flights: Flights, goal: float, how: How) -> tuple[float, float, float]:
    """What a mission spends until its map meets a goal.

    Returns:
        Share of the cells, E, and time in s with the landing; NaN when it never does.
    """
    energy, cells = along(place, flights, (how,)).reached(goal, how)
    if not math.isfinite(energy):
        return math.nan, math.nan, math.nan
    spent, _ = progress(place, flights)
    times_s = np.sort(np.concatenate([flight.time_s for flight in flights]))
    reached = min(int(np.searchsorted(spent, energy)), len(times_s) - 1)
    return cells, energy, float(times_s[reached]) + flights[0].landing_s


def shares(job: tuple[str, int, int]) -> dict[tuple[str, float], Share]:
    """What hovering costs over a field, (its name, agents, seed), for each swarm and goal."""
    name, agents, seed = job
    place, found = known(name, 0), dict[tuple[str, float], Share]()
    for swarm, mission in ((PLANNED, planned(place, agents, seed)), (CLASSIC, classic(place, agents, seed))):
        for goal in GOALS:
            cells, energy, time_s = until(place, mission.flights, goal, How.KR)
            decisions = math.nan if math.isnan(energy) else mission.decisions(time_s - mission.flights[0].landing_s)
            hover_j = decisions * WAIT_S * ENERGY.aircraft.hover.power_w
            found[swarm, goal] = hover_j / (energy * thorough_j(place, agents)), decisions / (cells * len(place.cells))
    wanderers = sweep(untaught(place, agents), exploration=1.0, seed=seed)
    for goal in GOALS:
        end = at(wanderers, "kr", goal)
        decision_j = WAIT_S * ENERGY.aircraft.hover.power_w / thorough_j(place, agents)
        share = end.hover_energy / (end.energy + end.hover_energy)
        found[GROUPS, goal] = share, end.hover_energy / decision_j / (end.cells * len(place.cells))
    return found


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--agents", type=int, default=4)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--fields", nargs="+", choices=NAMES, default=list(AIMED))
    arguments = parser.parse_args()
    jobs = [(name, arguments.agents, seed) for name in arguments.fields for seed in range(arguments.seeds)]
    with ProcessPoolExecutor(arguments.workers) as pool:
        Console(width=120).print(table(list(pool.map(shares, jobs))))


def table(found: Sequence[Mapping[tuple[str, float], Share]]) -> Table:
    """One row for each swarm and goal, mean over the missions that reach it."""
    result = Table("swarm", "goal", "hovering, share of the energy", "decisions a captured cell")
    for key in found[0]:
        share, decisions = np.nanmean([each[key] for each in found], axis=0)
        result.add_row(key[0], f"{key[1]:.0%}", f"{share:.1%}", f"{decisions:.2f}")
    return result


if __name__ == "__main__":
    main()

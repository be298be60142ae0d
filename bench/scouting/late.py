"""What does it cost to decide while flying, when the newest pictures are not known yet?

    python -m bench.scouting.late [--seeds 10] [--agents 4] [--workers 2] [--fields ...] [--moves 3]

The latencies of the profile, 5.1 s from the picture to the decision, are less than a move and a capture take (6 s). So
an agent that decides during its move never waits, if it can do without the newest capture of every agent. Printed:
accuracy of the planned swarm that decides so, minus that of one that knows all at once, at equal energy, in points.
"""

from __future__ import annotations

import argparse
import sys
from collections import deque
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.scouting.campaign import known
from bench.scouting.fields import NAMES, REAL, Field, averaged_over
from bench.scouting.flight import ENERGY, Flights, flown
from bench.scouting.informed import ENERGIES, HOWS
from bench.scouting.judge import CHECKPOINTS, along
from bench.scouting.ours import Ours
from bench.scouting.results import write
from bench.scouting.tables import points
from fleet.contexts.grid import Grid
from fleet.functions.belief import Belief
from fleet.planning.outlook import Outlook
from fleet.planning.scouting import Scout
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import Tactics

OUT = Path(__file__).resolve().parents[1] / "out" / "late.json"
Flags = NDArray[np.bool_]
Values = NDArray[np.float64]


class Hearsay(Belief):
    """A belief to which the newest captures are not known, only that they are captured."""

    def __init__(self, grid: Grid, lag: int) -> None:
        super().__init__(grid)
        self._lag = lag
        self._newest: deque[tuple[int, float]] = deque()

    def hear(self, cell: int, value: float) -> None:
        """One more capture; the one that is older than `lag` others becomes known."""
        self._newest.append((cell, value))
        if len(self._newest) > self._lag:
            oldest = self._newest.popleft()
            self.observe([oldest[0]], [oldest[1]])

    @property
    def free(self) -> Flags:
        """Cells with data that nobody has captured, bool [rows, columns]."""
        found = super().free.copy()
        found.flat[self.unheard] = False
        return found

    @property
    def unheard(self) -> list[int]:
        """The newest captured cells."""
        return [cell for cell, _ in self._newest]


class Late(Swarm):
    """A swarm that decides without the newest captures; its map and its claims have them."""

    def __init__(self, place: Field, agents: int, seed: int, tactics: Tactics, lag: int) -> None:
        super().__init__(Belief(place.grid), ENERGY, scattered(place.grid, agents, seed), tactics)
        self._place, self._heard = place, Hearsay(place.grid, lag)
        self.outlook = Outlook(self._heard, tactics.search.horizon)

    def scout(self) -> Flights:
        """Fly until every cell is captured."""
        self.fly(self._sense)
        return tuple(flown(self._place.grid, np.array(each.cells), np.array(each.captured)) for each in self.traces)

    def choose_path(self, scout: Scout) -> tuple[int, ...]:
        """From what has been heard."""
        self.outlook.claim(len(self.scouts), self._heard.unheard)
        now, self.belief = self.belief, self._heard
        try:
            return super().choose_path(scout)
        finally:
            self.belief = now

    def _sense(self, cell: int) -> float:
        value = float(self._place.truth[cell])
        self._heard.hear(cell, value)
        return value


def accuracies(job: tuple[str, int, int, int]) -> Values:
    """Accuracy at ENERGIES of both, over a field, (its name, agents, seed, moves); float64 [2, hows, energies]."""
    name, agents, seed, moves = job
    place, tactics = known(name, 0), Tactics(moves=moves)
    missions = Late(place, agents, seed, tactics, agents).scout(), Ours(tactics=tactics).fly(place, agents, seed, None)
    at = [int(np.argmin(np.abs(CHECKPOINTS - energy))) for energy in ENERGIES]
    curves = [along(place, flights, HOWS) for flights in missions]
    return np.array([[curve.accuracy[how][at] for how in HOWS] for curve in curves])


def table(names: list[str], found: Values) -> Table:
    """Points by which the late swarm is better, in the mean over ENERGIES.

    Args:
        found: float64 [fields, seeds, 2, hows, energies].
    """
    over = averaged_over(names)
    rows = [names.index(name) for name in over]
    result = Table("map by", f"mean of {len(over)}", *names)
    late, at_once = np.moveaxis(found.mean(axis=-1), 2, 0)
    for index, how in enumerate(HOWS):
        ours, theirs = late[..., index], at_once[..., index]
        each = [points(one, other) for one, other in zip(ours, theirs, strict=True)]
        result.add_row(how.value, points(ours[rows].mean(axis=0), theirs[rows].mean(axis=0)), *each)
    return result


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--agents", type=int, default=4)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--moves", type=int, default=Tactics().moves)
    parser.add_argument("--fields", nargs="+", choices=NAMES, default=list(REAL))
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    seeds = range(arguments.seeds)
    jobs = [(name, arguments.agents, seed, arguments.moves) for name in arguments.fields for seed in seeds]
    with ProcessPoolExecutor(arguments.workers) as pool:
        found = np.array(list(pool.map(accuracies, jobs)))
    shape = (len(arguments.fields), len(seeds), *found.shape[1:])
    Console(width=160).print(table(arguments.fields, found.reshape(shape)))
    runs = [
        {"field": name, "seed": seed, "late": late.round(5).tolist(), "at_once": at_once.round(5).tolist()}
        for (name, _, seed, _), (late, at_once) in zip(jobs, found, strict=True)
    ]
    content = {"agents": arguments.agents, "hows": [how.value for how in HOWS], "energy": ENERGIES, "runs": runs}
    write(arguments.out, " ".join(["python", *sys.orig_argv[1:]]), content)


if __name__ == "__main__":
    main()

"""How much sooner do more agents reach the goal, and for how much energy?

    python -m bench.scouting.sizes [--seeds 10] [--workers 2] [--fields ...]

Time from take-off to landing of a mission of the planned swarm that lands when the map is 80 % right (by neighbour mean
or by kriging with the class of the expected value, as in `bench.scouting.judge`), and the energy of all agents,
landings included: one agent's over that of several.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.scouting.campaign import known
from bench.scouting.ends import Spent, ends
from bench.scouting.fields import NAMES, REAL, averaged_over
from bench.scouting.flight import thorough_j
from bench.scouting.judge import How, times_of
from bench.scouting.ours import Ours
from bench.scouting.results import write

OUT = Path(__file__).resolve().parents[1] / "out" / "sizes.json"
Figures = NDArray[np.float64]
SIZES = (1, 2, 4, 8)
GOAL = 0.8
HOWS = (How.NM, How.KR)
Job = tuple[str, int, int]
"""Field, agents, seed."""


def main() -> None:
    """Fly, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--fields", nargs="+", choices=NAMES, default=list(REAL))
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    wanted = [(name, size, seed) for name in arguments.fields for size in SIZES for seed in range(arguments.seeds)]
    with ProcessPoolExecutor(arguments.workers) as pool:
        flown = dict(zip(wanted, pool.map(reached, wanted), strict=True))
    for how in HOWS:
        Console(width=140).print(table({job: each[how] for job, each in flown.items()}, how))
    figures = ("time_s", "energy_j", "balance")
    runs = [
        {"field": name, "agents": size, "seed": seed, "how": how.value, **dict(zip(figures, each[how], strict=True))}
        for (name, size, seed), each in flown.items() for how in HOWS
    ]  # fmt: skip
    write(arguments.out, " ".join(["python", *sys.orig_argv[1:]]), {"goal": GOAL, "runs": runs})


def reached(job: Job) -> dict[How, Spent]:
    """Time in s and energy in J of a mission up to the goal, for each map; and its slowest over mean flight."""
    name, agents, seed = job
    place = known(name, 0)
    flights = Ours().fly(place, agents, seed, None)
    found = ends(place, flights, (GOAL,), HOWS)
    all_j, balance = thorough_j(place, agents), times_of(flights)[1]
    return {how: (time_s, energy * all_j, balance) for (_, how), (_, energy, time_s) in found.items()}


def table(flown: Mapping[Job, Sequence[float]], how: How) -> Table:
    """A row for each field, and for the mean of those of the aims."""
    names = list(dict.fromkeys(name for name, _, _ in flown))
    seeds = list(dict.fromkeys(seed for _, _, seed in flown))
    mean = {(name, size): np.mean([flown[name, size, seed] for seed in seeds], axis=0) for name, size, _ in flown}
    ratios = {key: _ratios(mean[key[0], 1], each) for key, each in mean.items()}
    titles = [f"{size} agents: sooner, energy, slowest/mean" for size in SIZES[1:]]
    result = Table("field", *titles, title=f"to {GOAL:.0%}; map by {how}")
    for name in names:
        result.add_row(name, *(_text(ratios[name, size]) for size in SIZES[1:]))
    over = averaged_over(names)
    row = [_text(np.mean([ratios[name, size] for name in over], axis=0)) for size in SIZES[1:]]
    result.add_row(f"mean of {len(over)}", *row)
    return result


def _ratios(one: Figures, several: Figures) -> Figures:
    """How many times sooner, energy over that of one agent, slowest over mean flight."""
    return np.array([one[0] / several[0], several[1] / one[1], several[2]])


def _text(ratios: Figures) -> str:
    return f"{ratios[0]:.2f}, {ratios[1]:.2f}, {ratios[2]:.3f}"


if __name__ == "__main__":
    main()

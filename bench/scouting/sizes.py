"""How much sooner do more agents reach the goal, and for how much energy?

    python -m bench.scouting.sizes [--seeds 10] [--workers 2]

Time from take-off to landing of a mission that lands when the map is 80 % right (kriging, class of the expected value;
as in `bench.scouting.judge`), and the energy of all agents, landings included: one agent's over that of several.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.scouting.fields import AIMED, field
from bench.scouting.flight import thorough_j
from bench.scouting.judge import How, along, progress
from bench.scouting.ours import Ours

Figures = NDArray[np.float64]
SIZES = (1, 2, 4, 8)
GOAL = 0.8


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    wanted = [(name, size, seed) for name in AIMED for size in SIZES for seed in range(arguments.seeds)]
    with ProcessPoolExecutor(arguments.workers) as pool:
        flown = dict(zip(wanted, pool.map(reached, wanted), strict=True))
    seeds = range(arguments.seeds)
    mean = {(name, size): np.mean([flown[name, size, seed] for seed in seeds], axis=0) for name, size, _ in wanted}
    table = Table("field", *(f"{size} agents: sooner, energy, slowest/mean" for size in SIZES[1:]))
    ratios = {key: _ratios(mean[key[0], 1], each) for key, each in mean.items()}
    for name in AIMED:
        table.add_row(name, *(_text(ratios[name, size]) for size in SIZES[1:]))
    table.add_row("mean", *(_text(np.mean([ratios[name, size] for name in AIMED], axis=0)) for size in SIZES[1:]))
    Console(width=140).print(table)


def reached(job: tuple[str, int, int]) -> tuple[float, float, float]:
    """Time in s and energy in J of a mission, (field, agents, seed), up to the goal; its slowest over mean flight."""
    name, agents, seed = job
    place = field(name)
    flights = Ours().fly(place, agents, seed, None)
    curve = along(place, flights, (How.KR,))
    share, _ = curve.reached(GOAL, How.KR)
    spent, _ = progress(place, flights)
    times_s = np.sort(np.concatenate([flight.time_s for flight in flights]))
    at = min(int(np.searchsorted(spent, share)), len(times_s) - 1)
    return float(times_s[at]) + flights[0].landing_s, share * thorough_j(place, agents), curve.balance


def _ratios(one: Figures, several: Figures) -> Figures:
    """How many times sooner, energy over that of one agent, slowest over mean flight."""
    return np.array([one[0] / several[0], several[1] / one[1], several[2]])


def _text(ratios: Figures) -> str:
    return f"{ratios[0]:.2f}, {ratios[1]:.2f}, {ratios[2]:.3f}"


if __name__ == "__main__":
    main()

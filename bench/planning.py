"""What the planned swarm's decisions and missions cost as fields grow; each beside whole fields in numpy and Python.

    python -m bench.run planning
    python -m bench.planning --whole

Fields are smooth and made up by spectral synthesis. One mission flies over each until every cell is captured, or until
100,000 are (the first tenth of the largest: cells are predicted and fitted anew most often at first, so on average a
capture of the whole mission is cheaper; `--whole` flies all of it, in a quarter of an hour). A decision is the outlook
and the path; a claim is what the stop rule is asked about, and is timed when half is captured. A capture's cost is the
mission's time over its captures: sensing, taking in, fits, and its share of decisions and claims. Time is that of the
processor, for a mission is too long to be repeated.

The plain form decides once, when half of the captures are made: the map from scratch in numpy, interest of every cell,
the richest place by a filter over the whole field, and the beam search in Python. A capture's plain cost is that of as
many decisions as were flown.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve, distance_transform_edt, uniform_filter

from bench.belief import from_scratch, in_numpy
from bench.measure import Result, seconds
from bench.scouting.flight import ENERGY
from fleet.contexts.base import Environment
from fleet.contexts.grid import Grid
from fleet.functions import kriging
from fleet.functions.belief import Belief
from fleet.functions.classes import class_probabilities
from fleet.missions.layout import MOVES
from fleet.planning.calibration import expected_accuracy
from fleet.planning.interest import AROUND, FAR
from fleet.planning.paths import STRAIGHT
from fleet.planning.scouting import Scout
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import Tactics

COMMAND = "python -m bench.run planning"
PLAIN = "whole field in numpy, beam in Python"
CELL_M = 10.0
MOST = 100_000
"""Captures after which a mission ends, unless it is flown whole."""
SIZES = ((1_000, 4), (10_000, 4), (10_000, 100), (100_000, 100), (1_000_000, 100))
"""Cells and agents."""
Values = NDArray[np.float64]


@dataclass(eq=False)
class Flight:
    """What a mission took, in s.

    Args:
        whole: The mission, without what follows.
        decisions: Each decision.
        claim, plain: A claim, and a decision in the plain form, when half was captured.
        captured: Cells.
    """

    whole: float = 0.0
    decisions: list[float] = field(default_factory=list)
    claim: float = 0.0
    plain: float = 0.0
    captured: int = 0


class Timed(Swarm):
    """Keeps what each decision took."""

    taken: list[float]

    def choose_path(self, scout: Scout) -> tuple[int, ...]:
        start = time.process_time()
        path = super().choose_path(scout)
        self.taken.append(time.process_time() - start)
        return path


def run(whole: bool = False) -> list[Result]:
    kriging.prepare_for_many()
    mission(synthesised(2_000), 4, 200)  # compiles
    results: list[Result] = []
    for cells, agents in SIZES:
        results += of_size(cells, agents, cells if whole else min(cells, MOST))
    return results


def of_size(cells: int, agents: int, captures: int) -> list[Result]:
    """Figures of one mission."""
    flight = mission(synthesised(cells), agents, captures)
    taken = np.array(flight.decisions) * 1e3
    a_capture, share = flight.whole / flight.captured * 1e3, len(taken) / flight.captured
    name = f"{cells:,} cells, {agents} agents, {flight.captured:,} captured"
    longest = float(np.quantile(taken, 0.99))
    plain = flight.plain * 1e3
    return [
        Result.against(f"a decision with belief, mean, {name}", taken.mean(), "ms", (PLAIN, plain), COMMAND),
        Result(f"a decision with belief, 99 %, {name}", longest, "ms", command=COMMAND),
        Result(f"a claim, {name}", flight.claim * 1e3, "ms", command=COMMAND),
        Result.against(f"a mission for each capture, {name}", a_capture, "ms", (PLAIN, share * plain), COMMAND),
    ]


def mission(environment: Environment, agents: int, captures: int) -> Flight:
    """Fly until so many cells are captured."""
    assert environment.truth is not None
    truth = environment.truth.reshape(-1)
    swarm = Timed(Belief.over(environment), ENERGY, scattered(environment.grid, agents, 0), Tactics())
    swarm.taken = []
    flight = Flight(decisions=swarm.taken)

    def ask() -> bool:
        if swarm.belief.captured >= captures / 2 and not flight.plain:
            start = time.process_time()
            flight.claim = seconds(lambda: expected_accuracy(swarm.belief, swarm.calibration))
            flight.plain = plain_decision(swarm, environment)
            flight.whole -= time.process_time() - start
        return swarm.belief.captured >= captures

    start = time.process_time()
    swarm.fly(lambda cell: float(truth[cell]), watch=ask)
    flight.whole += time.process_time() - start
    flight.captured = swarm.belief.captured
    return flight


def synthesised(cells: int) -> Environment:
    """A smooth field about 100 on a square grid of about so many cells: white noise whose spectrum falls with the third
    power of the frequency, but not below that of 60 cells, so that a larger field has more patches, not larger ones."""
    side = round(cells**0.5)
    generator = np.random.default_rng(7)
    down, across = np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side)[None, :]
    spectrum = (down**2 + across**2 + (1.0 / 60.0) ** 2) ** -0.75
    drawn = np.fft.irfft2(np.fft.rfft2(generator.normal(size=(side, side))) * spectrum, (side, side))
    truth = 100.0 + 15.0 * (drawn - drawn.mean()) / drawn.std()
    grid = Grid(np.ones_like(truth, dtype=bool), CELL_M, CELL_M)
    return Environment("a made-up field", "", grid, "exg", truth)


def plain_decision(swarm: Swarm, environment: Environment) -> float:
    """Seconds of one decision of the first agent."""
    scout, tactics, grid = swarm.scouts[0], Tactics(), environment.grid
    start, known = time.process_time(), swarm.belief.known
    with in_numpy():
        map_ = from_scratch(swarm.belief, known, environment)
    likely = class_probabilities(map_, float(np.nanmean(map_.values))).max(axis=0)
    doubt = np.where(known, 0.0, 1.0 - likely)
    wanted = tactics.weights.doubt * doubt + tactics.weights.doubt_around * convolve(doubt, AROUND, mode="constant")
    wanted += tactics.weights.novelty * (1.0 - np.exp(-distance_transform_edt(~known) / FAR))
    wanted = np.where(grid.valid & ~known, wanted, 0.0)
    found = np.sort(wanted[wanted > 0.0])
    rate = tactics.thrift * float(found[len(found) // 2 :].mean()) / swarm.finder.mean_move_j if len(found) else 0.0
    if not plain_beam(wanted, grid, scout, rate):
        row, column = grid.position(scout.cell)
        rows, columns = np.ogrid[: grid.rows, : grid.columns]
        (uniform_filter(wanted, 5, mode="constant") / (np.abs(rows - row) + np.abs(columns - column) + 6.0)).argmax()
    return time.process_time() - start


def plain_beam(wanted: Values, grid: Grid, scout: Scout, rate: float) -> float:
    """What the best path is worth that beam search finds."""
    costs = [rate * ENERGY.move(move).energy_j for move in MOVES[:STRAIGHT]]
    capture, look = rate * ENERGY.capture().energy_j, Tactics().search
    paths, most = [(0.0, scout.cell, scout.last, frozenset[int]())], 0.0
    for _ in range(look.horizon):
        longer = {}
        for value, cell, last, seen in paths:
            for move in range(STRAIGHT):
                reached = grid.neighbour(cell, MOVES[move])
                if reached is None or (last >= 0 and last ^ 1 == move):
                    continue
                fresh = wanted.flat[reached] > 0.0 and reached not in seen
                worth = value - costs[move] + (wanted.flat[reached] - capture if fresh else 0.0)
                longer.setdefault((worth, reached, move), (worth, reached, move, seen | {reached}))
        paths = sorted(longer.values(), key=lambda path: -path[0])[: look.width]
        most = max([most, *(path[0] for path in paths[:1])])
    return most


if __name__ == "__main__":
    if "--whole" in sys.argv[1:]:
        from rich.console import Console

        from bench.run import table_of

        Console(width=160).print(table_of(run(whole=True)))
    else:
        from bench.run import main

        sys.exit(main(["planning"]))

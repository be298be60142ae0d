"""Does the swarm know when its map is good enough?

    python -m bench.scouting.stops [--seeds 10] [--agents 4] [--workers 2] [--fields ...]

For each field the stop rule is learned from simulated missions over the other fields (never the one that is flown), so
that it ends CONFIDENCE of them with the goal met. Then missions over the field end by that rule. Printed: the share
that met the goal; their energy over that of a clairvoyant, who lands as soon as the map is good enough for three claims
in a row; what the swarm claimed at the end minus what was true, and how far off a mission's claim was either way, in
points. A mission that never meets the goal has no clairvoyant, and its energy does not count.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from bench.scouting.fields import NAMES, REAL, averaged_over, field
from bench.scouting.flight import ENERGY
from bench.scouting.results import write
from fleet.planning.rehearsal import rehearse
from fleet.planning.stop import Claims, StopRule, learned
from fleet.planning.tactics import Tactics

OUT = Path(__file__).resolve().parents[1] / "out" / "stops.json"
GOALS = (0.7, 0.8)
CONFIDENCE = 0.93
Missions = Mapping[tuple[str, int], Claims]
"""By field and seed."""


@dataclass(frozen=True)
class Row:
    """Means over the missions of one field.

    Args:
        caution: Of the rule.
        met: Share of the missions that met the goal.
        energy: Energy over the clairvoyant's.
        claimed: Claimed minus true accuracy at the end.
        off: The same either way.
    """

    field: str
    goal: float
    caution: float
    met: float
    energy: float
    claimed: float
    off: float


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--agents", type=int, default=4)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--fields", nargs="+", choices=NAMES, default=list(REAL))
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    wanted = [(name, arguments.agents, seed) for name in arguments.fields for seed in range(arguments.seeds)]
    with ProcessPoolExecutor(arguments.workers) as pool:
        found = pool.map(flown, wanted)
        missions = {(name, seed): claims for (name, _, seed), claims in zip(wanted, found, strict=True)}
    ended_by_rules = list(rows(missions))
    show(ended_by_rules)
    content = {"agents": arguments.agents, "seeds": arguments.seeds, "rows": [asdict(row) for row in ended_by_rules]}
    write(arguments.out, " ".join(["python", *sys.orig_argv[1:]]), content)


def flown(job: tuple[str, int, int]) -> Claims:
    """A mission over a field, (its name, agents, seed), until every cell is captured."""
    name, agents, seed = job
    return rehearse(field(name).environment, ENERGY, agents, Tactics(), seed)


def rows(missions: Missions) -> Iterator[Row]:
    """What the rules do, that were learned on all fields but the one that is flown."""
    for goal in GOALS:
        for name in dict.fromkeys(name for name, _ in missions):
            contexts = [claims for (other, _), claims in missions.items() if other != name]
            rule = learned(contexts, goal, CONFIDENCE)
            ends = [ended(claims, rule) for (other, _), claims in missions.items() if other == name]
            yield Row(name, goal, rule.caution, *(float(mean) for mean in np.nanmean(ends, axis=0)))


def ended(claims: Claims, rule: StopRule) -> tuple[float, float, float, float]:
    """Whether a mission met the goal when the rule ended it, its energy over a clairvoyant's, its claim's error, and
    that either way."""
    stop = claims.stop(rule)
    at = len(claims.truth) - 1 if stop is None else stop
    met = claims.truth >= rule.goal
    in_a_row = met & np.append(met[1:], True) & np.append(met[2:], [True, True])
    share = claims.energy_j[at] / claims.energy_j[int(in_a_row.argmax())] if in_a_row.any() else np.nan
    error = float(claims.claimed[at] - claims.truth[at])
    return float(met[at]), float(share), error, abs(error)


def show(found: Sequence[Row]) -> None:
    """Print a table, with the mean over the fields of the aims."""
    over = averaged_over([row.field for row in found])
    table = Table(
        "goal", "field", "caution", "goal met", "energy over clairvoyant", "claimed - true, points", "either way"
    )
    for goal in GOALS:
        of_goal = [row for row in found if row.goal == goal]
        for row in of_goal:
            figures = (
                f"{row.caution:.2f}",
                f"{row.met:.0%}",
                f"{row.energy:.2f}",
                f"{100 * row.claimed:+.1f}",
                f"{100 * row.off:.1f}",
            )
            table.add_row(f"{goal:.0%}", row.field, *figures)
        means = [(row.met, row.energy, row.claimed, row.off) for row in of_goal if row.field in over]
        met, energy, claimed, off = np.mean(means, axis=0)
        means_told = (f"{met:.1%}", f"{energy:.2f}", f"{100 * claimed:+.1f}", f"{100 * off:.1f}")
        table.add_row(f"{goal:.0%}", f"mean of {len(means)}", "", *means_told)
    Console(width=120).print(table)


if __name__ == "__main__":
    main()

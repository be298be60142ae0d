"""Do goals come nearer from mission to mission, because a mission expects what the missions before it found?

    python -m bench.scouting.memory [--seeds 10] [--goals 0.7 0.8] [--missions 10] [--fields ...] [--workers 2]

The planned swarm flies a field again and again, while it drifts: from mission to mission a smooth random field of a
fifth of its deviation is added (as in `bench.weights`). `corn-dates` flies the three dates of the corn field in order,
drifting between them: from date to date, six weeks and more, hardly anything of the field is left. With memory each
mission is told the map that the last one left (`fleet.runtime.remembering`), and so is the one that judges it; without,
neither. Both arms have the same fields and take-offs. Missions end by the platform's usual caution for the goal.

Printed for each goal: energy of the first, second, fifth and last mission as a share E of visiting every cell; the
share of all missions that met the goal; what missions 2 to 10 claimed minus what was true; and their energy over that
without memory, with 95 % intervals over the seeds.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.ndimage import gaussian_filter

from bench.scouting.campaign import known
from bench.scouting.fields import CORN, REAL, Field
from bench.scouting.flight import ENERGY, thorough_j
from bench.scouting.results import write
from bench.statistics import interval
from bench.weights import DRIFT, DRIFT_CELLS
from fleet.contexts.base import Environment
from fleet.functions.belief import Belief
from fleet.functions.classes import classes, likely_values
from fleet.functions.extrapolation import extrapolate
from fleet.planning.stop import StopRule, usual_caution
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import Tactics
from fleet.runtime.remembering import filled, found

OUT = Path(__file__).resolve().parents[1] / "out" / "memory.json"
Values = NDArray[np.float64]
DATES = "corn-dates"
AGENTS = 4
TOLD = (1, 2, 5, 10)
"""Missions whose energy is printed."""


@dataclass(frozen=True)
class Campaign:
    """Missions over one field.

    Args:
        field: Its name, or `corn-dates`.
        seed: Of its drift and of the places where agents take off.
        goal: Accuracy.
        missions: How many.
        remembers: Whether a mission expects what the last one found.
    """

    field: str
    seed: int
    goal: float
    missions: int
    remembers: bool


def drifting(campaign: Campaign) -> Iterator[Environment]:
    """The field of each mission; each of several dates has an equal share of the missions."""
    places = [known(name, 0).environment for name in (CORN if campaign.field == DATES else [campaign.field])]
    generator = np.random.default_rng([campaign.seed, 7])
    walked = np.zeros(places[0].grid.valid.shape)
    for number in range(campaign.missions):
        place = places[number * len(places) // campaign.missions]
        assert place.truth is not None  # fields of benchmarks have it
        yield replace(place, truth=place.truth + walked * float(np.nanstd(place.truth)))
        step = gaussian_filter(generator.normal(size=walked.shape), DRIFT_CELLS)
        walked = walked + DRIFT * step / step.std()


def flown(campaign: Campaign) -> list[tuple[float, float, float]]:
    """E, accuracy, and claimed minus true accuracy of each mission."""
    rule, left, result = StopRule(campaign.goal, usual_caution(campaign.goal)), None, list[tuple[float, float, float]]()
    for number, drifted in enumerate(drifting(campaign)):
        place = replace(drifted, expected=left)
        scouts = scattered(place.grid, AGENTS, 1000 * campaign.seed + number)
        swarm = Swarm(Belief.over(place), ENERGY, scouts, Tactics(), rule)
        assert place.truth is not None  # as above
        swarm.fly(place.truth.item)
        captured = np.full(place.grid.valid.shape, np.nan)
        captured.flat[swarm.captured] = place.truth.flat[swarm.captured]
        accuracy = _accuracy(place, captured)
        result.append(
            (swarm.spent_j / thorough_j(Field(place), AGENTS), accuracy, swarm.claims[-1].accuracy - accuracy)
        )
        map_ = found(place, captured) if campaign.remembers else None
        left = None if map_ is None else filled(map_, place.grid.valid)
    return result


def _accuracy(place: Environment, captured: Values) -> float:
    """Of the map of likely classes, which Eval() of the example makes too."""
    assert place.truth is not None  # as above
    mean = float(place.truth[place.grid.valid].mean())
    prediction = extrapolate(captured, place.grid, expected=place.expected)
    right = classes(likely_values(prediction, mean), mean) == classes(place.truth, mean)
    return float(right[place.grid.valid].mean())


def table(goal: float, found_by: Mapping[Campaign, list[tuple[float, float, float]]]) -> Table:
    """One row for each field and arm."""
    last = max(campaign.missions for campaign in found_by)
    told = [number for number in TOLD if number <= last]
    result = Table(
        "field", "memory", *(f"E of mission {number}" for number in told), "goal met", "claimed - true, points",
        "energy over without",
        title=f"goal {goal:.0%}",
    )  # fmt: skip
    for name in dict.fromkeys(campaign.field for campaign in found_by):
        arms = {
            remembers: np.array([
                missions for campaign, missions in found_by.items()
                if (campaign.field, campaign.goal, campaign.remembers) == (name, goal, remembers)
            ])
            for remembers in (False, True)
        }  # fmt: skip
        for remembers, figures in arms.items():
            energy, accuracy = figures[..., 0], figures[..., 1]
            share = ""
            if remembers:
                each = interval(energy[:, 1:].mean(axis=1) / arms[False][:, 1:, 0].mean(axis=1))
                share = f"{each.mean:.2f} [{each.low:.2f}, {each.high:.2f}]"
            result.add_row(
                name, "yes" if remembers else "no", *(f"{energy[:, number - 1].mean():.3f}" for number in told),
                f"{(accuracy >= goal).mean():.1%}", f"{100 * figures[:, 1:, 2].mean():+.1f}", share,
            )  # fmt: skip
    return result


def main() -> None:
    """Fly, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--goals", nargs="+", type=float, default=[0.7, 0.8])
    parser.add_argument("--missions", type=int, default=10)
    parser.add_argument("--fields", nargs="+", choices=[*REAL, DATES], default=[*REAL, DATES])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    wanted = [
        Campaign(name, seed, goal, arguments.missions, remembers)
        for goal in arguments.goals for name in arguments.fields
        for seed in range(arguments.seeds) for remembers in (False, True)
    ]  # fmt: skip
    with ProcessPoolExecutor(arguments.workers) as pool:
        results = dict(zip(wanted, pool.map(flown, wanted), strict=True))
    for goal in arguments.goals:
        Console(width=None if sys.stdout.isatty() else 140).print(table(goal, results))
    runs = [
        {
            "field": campaign.field, "seed": campaign.seed, "goal": campaign.goal, "memory": campaign.remembers,
            "energy": [energy for energy, *_ in missions], "claim_error": [error for *_, error in missions],
            "accuracy": [accuracy for _, accuracy, _ in missions],
        }
        for campaign, missions in results.items()
    ]  # fmt: skip
    write(arguments.out, " ".join(["python", *sys.orig_argv[1:]]), {"drift": DRIFT, "runs": runs})


if __name__ == "__main__":
    main()

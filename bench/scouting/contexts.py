"""What can other fields tell the planned swarm that it does not know without them?

    python -m bench.scouting.contexts [--short] [--seeds 10] [--agents 4] [--workers 2] [--fields ...]

The swarm flies each field with what was learned on the others alone, and as a bound with what only the flown field
itself can tell. Printed: accuracy in points above that of the default, mean over E of 20 to 60 %, with 95 % intervals:
of the fields of the aims together, and of each field.

- equal weights: of the features of interest; where reward shaping starts.
- weights by gains: coefficients of what captures brought (`bench.scouting.gains`).
- weights by search: the best of a coarse grid in the mean of the other fields.
- variogram: length and nugget, fading as captures come in.
- bounds: the flown field's own mean and variogram; the weights that are best on itself, with the very same seeds.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.scouting.campaign import known
from bench.scouting.fields import NAMES, REAL, averaged_over
from bench.scouting.gains import Gains, gains, learned, missions
from bench.scouting.informed import ENERGIES, HOWS, NOTHING, Mission, Prior, accuracy, variogram_of
from bench.scouting.results import write
from bench.scouting.tables import points
from bench.statistics import paired
from fleet.planning.tactics import InterestWeights, Tactics

OUT = Path(__file__).resolve().parents[1] / "out" / "contexts.json"
Values = NDArray[np.float64]
Told = tuple[Tactics, Prior]
"""What a swarm is told beforehand."""
Telling = Callable[[str], Told]
"""What is told about a field, by its name."""
Lessons = Mapping[str, Sequence[Gains]]
"""Gains by field."""
EQUAL = Tactics(weights=InterestWeights(doubt=1.0, doubt_around=1.0, novelty=1.0))
_GRID = tuple(product((0.0, 0.5, 1.0, 2.0, 4.0), (0.0, 0.1, 0.3, 1.0, 3.0)))
_SHORT_GRID = tuple(product((0.0, 1.0), (0.0, 0.3, 1.0)))
_FADES = 30.0
_OTHER_SEEDS = 100
"""Flights that are learned from have other seeds than those that are judged."""


def tactics_of(grid: Iterable[tuple[float, float]]) -> tuple[Tactics, ...]:
    """The default, and tactics with other weights (doubt around, novelty)."""
    found = [Tactics(weights=InterestWeights(doubt_around=around, novelty=novelty)) for around, novelty in grid]
    return (NOTHING, *(tactics for tactics in found if tactics != NOTHING))


@dataclass(frozen=True)
class Study:
    """What is flown.

    Args:
        fields, agents, seeds: Every field with every seed.
        searched: Tactics among which the best is searched.
    """

    fields: Sequence[str]
    agents: int
    seeds: Sequence[int]
    searched: Sequence[Tactics]

    def others(self, name: str) -> list[str]:
        """The fields that are known before one is flown."""
        return [other for other in self.fields if other != name]

    def missions(self, told: Telling) -> list[Mission]:
        """All missions of a swarm, by field and seed."""
        return [Mission(name, self.agents, seed, *told(name)) for name in self.fields for seed in self.seeds]

    def accuracy(self, pool: ProcessPoolExecutor, told: Telling) -> Values:
        """Accuracy, float64 [fields, seeds, hows, energies]."""
        found = list(pool.map(accuracy, self.missions(told), chunksize=2))
        return np.array(found).reshape(len(self.fields), len(self.seeds), len(HOWS), len(ENERGIES))

    def lessons(self, pool: ProcessPoolExecutor) -> Lessons:
        """What captures brought on each field."""
        wanted = missions(self.fields, self.agents, [seed + _OTHER_SEEDS for seed in self.seeds])
        found = list(zip(wanted, pool.map(gains, wanted, chunksize=2), strict=True))
        return {name: [each for mission, each in found if mission.field == name] for name in self.fields}


def always(tactics: Tactics) -> Telling:
    """The same tactics on every field, and nothing else."""
    return lambda _: (tactics, Prior())


def by_gains(study: Study, lessons: Lessons) -> Telling:
    """Weights learned on the other fields."""
    weights = {
        name: learned([each for other in study.others(name) for each in lessons[other]]) for name in study.fields
    }
    return lambda name: (Tactics(weights=weights[name]), Prior())


def by_search(study: Study, scores: Sequence[Values], among: Callable[[str], Sequence[str]]) -> Values:
    """Accuracy with the tactics that are best in the mean over some fields, those `among` names for each.

    Args:
        scores: Accuracy with each of the searched tactics.
    """
    found = []
    for index, name in enumerate(study.fields):
        rows = [study.fields.index(other) for other in among(name)]
        best = int(np.argmax([score[rows].mean() for score in scores]))
        found.append(scores[best][index])
    return np.array(found)


def variogram_of_others(study: Study) -> Telling:
    """Length (geometric mean) and nugget of the other fields, fading."""
    own = {name: variogram_of(name) for name in study.fields}

    def told(name: str) -> Told:
        rest = [own[other] for other in study.others(name)]
        length = float(np.exp(np.mean([np.log(each.length) for each in rest])))
        return NOTHING, Prior(length, float(np.mean([each.nugget for each in rest])), _FADES)

    return told


def own_mean(name: str) -> Told:
    """The flown field's mean."""
    return NOTHING, Prior(mean=float(np.nanmean(known(name, 0).truth)))


def own_variogram(name: str) -> Told:
    """The flown field's variogram and mean."""
    own = variogram_of(name)
    return NOTHING, Prior(own.length, own.nugget, np.inf, own_mean(name)[1].mean)


def measured(study: Study, pool: ProcessPoolExecutor) -> dict[str, Values]:
    """Accuracy of every swarm, the default first; float64 [fields, seeds, hows, energies]."""
    scores = [study.accuracy(pool, always(tactics)) for tactics in study.searched]
    return {
        "default": scores[study.searched.index(NOTHING)],
        "equal weights": study.accuracy(pool, always(EQUAL)),
        "others: weights by gains": study.accuracy(pool, by_gains(study, study.lessons(pool))),
        "others: weights by search": by_search(study, scores, study.others),
        "others: variogram": study.accuracy(pool, variogram_of_others(study)),
        "bound: own mean": study.accuracy(pool, own_mean),
        "bound: own variogram and mean": study.accuracy(pool, own_variogram),
        "bound: own weights by search": by_search(study, scores, lambda name: [name]),
    }


def table(study: Study, found: Mapping[str, Values], how: int) -> Table:
    """Points above the default, in the mean over E, of all fields and of each, with intervals."""
    over = averaged_over(study.fields)
    rows = [study.fields.index(name) for name in over]
    result = Table(
        "told beforehand", f"mean of {len(over)}", *study.fields, title=f"minus the default, {HOWS[how]}, points"
    )
    base = found["default"][:, :, how].mean(axis=-1)
    for name, each in found.items():
        if name != "default":
            ours = each[:, :, how].mean(axis=-1)
            row = [points(ours[index], base[index]) for index in range(len(study.fields))]
            result.add_row(name, points(ours[rows].mean(axis=0), base[rows].mean(axis=0)), *row)
    return result


def document(study: Study, found: Mapping[str, Values]) -> dict[str, object]:
    """The results, for JSON."""
    base = found["default"]
    rows = [study.fields.index(name) for name in averaged_over(study.fields)]
    runs = [
        {
            "told": name,
            "how": how.value,
            "accuracy": each[:, :, index].mean(axis=1).round(5).tolist(),
            "points": 100 * paired(*(part[rows][:, :, index].mean(axis=(0, 2)) for part in (each, base))).mean,
        }
        for name, each in found.items()
        for index, how in enumerate(HOWS)
    ]
    return {"fields": list(study.fields), "energy": ENERGIES, "runs": runs}


def main() -> None:
    """Fly, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="2 seeds and a coarser grid")
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--agents", type=int, default=4)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--fields", nargs="+", choices=NAMES, default=list(REAL))
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    seeds = range(arguments.seeds or (2 if arguments.short else 10))
    study = Study(arguments.fields, arguments.agents, seeds, tactics_of(_SHORT_GRID if arguments.short else _GRID))
    with ProcessPoolExecutor(arguments.workers) as pool:
        found = measured(study, pool)
    console = Console(width=None if sys.stdout.isatty() else 160)
    for how in range(len(HOWS)):
        console.print(table(study, found, how))
    write(arguments.out, " ".join(["python", *sys.orig_argv[1:]]), document(study, found))


if __name__ == "__main__":
    main()

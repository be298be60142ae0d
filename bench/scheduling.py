"""Aggregators by level in a cluster that is too small for all: waiting, lifetime, and what becomes of sensors.

    python -m bench.run scheduling
    python -m bench.scheduling --short      (alone: only levels 9, 8 and 1)

A test bed of a hub that takes no pods and four gateways of a tenth of a core, on each of which one aggregator has room
beside the sensor of an agent (needs root; see tests/testbed). A mission of the example over the whole field is flown
first, on this computer; what its 15 aggregators do is then the same in every run:

- alone: one Job at a time, with the share of one that has the cluster for itself;
- together: all Jobs at once, levels 0..9 spread over the subsets, compiled and shared as the operator does it;
- the peer: all Jobs at once with the same priority, the same request and no share, level 0 as well.

Times are those of the API, which are whole seconds: from the creation of the Job to the start of its container, and
from there to the end.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from bench.measure import Result
from bench.scheduling_bed.cluster import CORES, Run, SmallCluster, small_cluster, without_shares
from bench.scheduling_bed.flight import FLOWN, Flight
from bench.scheduling_bed.lives import Life
from fleet.missions.documents import WeightsDocument
from fleet_operator.compiler.target import AggregatorTerms
from fleet_operator.flow.orders import aggregator_terms

COMMAND = "python -m bench.scheduling"
PEER = "no priorities, no shares"
LEVELS = (4, 1, 6, 2, 8, 5, 0, 3, 9, 7, 1, 8, 4, 2, 6)
"""Level of each subset in the order of the powerset: large and small ones at all levels."""
URGENT, LOWEST, EQUAL = 8, 2, 5


def terms_of(small: SmallCluster, subsets: Sequence[str], levels: Mapping[str, int]) -> tuple[AggregatorTerms, ...]:
    """Terms as the operator finds them after a mission with this usefulness; subsets that are left out are useless."""
    usefulness = {subset: levels.get(subset, 0) / 10 for subset in subsets}
    history = {FLOWN: WeightsDocument(number=FLOWN, weights={}, usefulness=dict(usefulness))}
    return aggregator_terms(small.target.fleet, history, FLOWN, small.room, subsets)


def alone(small: SmallCluster, levels: Mapping[str, int]) -> dict[str, Life]:
    """Each aggregator with the cluster for itself."""
    found: dict[str, Life] = {}
    for subset, level in levels.items():
        found |= small.run(terms_of(small, [subset], {subset: level})).lives
        _say(f"alone: {_text(found[subset])}")
    return found


def by_level(loaded: Run, peer: Run, unloaded: Mapping[str, Life], levels: Mapping[str, int]) -> list[Result]:
    """Figures for people: each level's, the highest first, and those that the levels are for."""
    found = []
    for level in sorted({levels[subset] for subset in unloaded}, reverse=True):
        subsets = [subset for subset in unloaded if levels[subset] == level]
        found += [
            _beside(f"level {level}, waiting", "s", *(_mean(_waiting(run, subsets)) for run in (loaded, peer))),
            _beside(f"level {level}, lifetime", "s", *(_mean(_lifetimes(run, subsets)) for run in (loaded, peer))),
            _beside(
                f"level {level}, lifetime / lifetime alone",
                "",
                *(_mean(_growth(run, unloaded, subsets)) for run in (loaded, peer)),
            ),
        ]
    urgent = [subset for subset in unloaded if levels[subset] >= URGENT]
    lowest = [subset for subset in unloaded if levels[subset] <= LOWEST]
    return [
        *found,
        _beside("levels 8 and 9, longest waiting", "s", *(max(_waiting(run, urgent)) for run in (loaded, peer))),
        _beside(
            "levels 8 and 9, largest lifetime / lifetime alone",
            "",
            *(max(_growth(run, unloaded, urgent)) for run in (loaded, peer)),
        ),
        _beside(
            "levels 1 and 2, waiting / lifetime alone",
            "",
            *(_mean(_relative_waiting(run, unloaded, lowest)) for run in (loaded, peer)),
        ),
        _beside(
            "until a model is there, weighted by its level", "s", *(_useful_s(run, levels) for run in (loaded, peer))
        ),
        _beside("until all models are there", "s", *(_whole_s(run, levels) for run in (loaded, peer))),
    ]


def _beside(name: str, unit: str, value: float, peer: float) -> Result:
    return Result(f"scheduling, {name}", value, unit, PEER, peer, value / peer if peer else None, COMMAND)


def _waiting(run: Run, subsets: Iterable[str]) -> list[float]:
    return [run.lives[subset].waiting_s for subset in subsets]


def _lifetimes(run: Run, subsets: Iterable[str]) -> list[float]:
    return [run.lives[subset].lifetime_s for subset in subsets]


def _growth(run: Run, unloaded: Mapping[str, Life], subsets: Iterable[str]) -> list[float]:
    return [run.lives[subset].lifetime_s / unloaded[subset].lifetime_s for subset in subsets]


def _relative_waiting(run: Run, unloaded: Mapping[str, Life], subsets: Iterable[str]) -> list[float]:
    return [run.lives[subset].waiting_s / unloaded[subset].lifetime_s for subset in subsets]


def _useful_s(run: Run, levels: Mapping[str, int]) -> float:
    """Mean time from the creation of a Job to the new model, where a model of level 9 counts nine times."""
    return sum(level * run.lives[subset].whole_s for subset, level in levels.items() if level) / sum(levels.values())


def _whole_s(run: Run, levels: Mapping[str, int]) -> float:
    return max(run.lives[subset].whole_s for subset, level in levels.items() if level)


def _mean(values: Sequence[float]) -> float:
    return statistics.mean(values)


def run(short: bool = False) -> list[Result]:
    before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory(prefix="fleet-bench-") as name:
        _say("a mission is flown")
        flight = Flight(Path(name), CORES)
        levels = dict(zip(flight.subsets, LEVELS, strict=True))
        wanted = {9, 8, 1} if short else set(range(1, 10))
        _say("the cluster and its sensors start")
        with small_cluster(Path(name) / "bed", flight) as small:
            loaded = small.run(terms_of(small, flight.subsets, levels))
            _tell("together", loaded, levels)
            equal = [AggregatorTerms(subset, EQUAL) for subset in flight.subsets]
            peer = small.run(equal, without_shares(small.target))
            _tell(PEER, peer, levels)
            unloaded = alone(small, {subset: level for subset, level in levels.items() if level in wanted})
            lost = small.lost_sensors()
    return [
        *by_level(loaded, peer, unloaded, levels),
        Result("scheduling, aggregators preempted", loaded.preempted, "", PEER, peer.preempted, command=COMMAND),
        Result("scheduling, sensors preempted or started again", lost, "", command=COMMAND),
        Result("scheduling, load average before", before, "", command=COMMAND),
        Result("scheduling, load average after", os.getloadavg()[0], "", command=COMMAND),
    ]


def _tell(name: str, run: Run, levels: Mapping[str, int]) -> None:
    for subset in sorted(run.lives, key=lambda subset: (-levels[subset], subset)):
        _say(f"{name}, level {levels[subset]}: {_text(run.lives[subset])}")


def _text(life: Life) -> str:
    pods = "" if life.pods == 1 else f", {life.pods} pods"
    return f"subset {life.subset} waited {life.waiting_s:.0f} s, lived {life.lifetime_s:.0f} s{pods}"


def _say(text: str) -> None:
    print(f"  {time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="only levels 9, 8 and 1 alone")
    given = parser.parse_args(arguments)
    from rich.console import Console  # noqa: PLC0415 - only here

    from bench.run import table_of  # noqa: PLC0415 - it imports this module by name

    Console(width=None if sys.stdout.isatty() else 140).print(table_of(run(given.short)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

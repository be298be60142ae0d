"""The operator with a thousand fleets on a thousand machines: objects a second, memory, calls at rest, time to effect.

    python -m bench.run operator
    python -m bench.operator --fleets 100 --nodes 100 --without-pods     (a short one)

A real API server with etcd, controller manager and scheduler, machines and pods by KWOK. Storage is a folder in
memory; what roles would leave there is written by one process when KWOK runs their pods. All fleets of 4 agents are
trained, then resumed at once, fly, retrain (15 aggregators) and weigh: 25 Jobs each. Without pods there are no
controllers, scheduler and KWOK, and the same process ends the Jobs, which is many times faster.

Objects a second are measured twice, with controllers, scheduler and KWOK stopped, so that only the API server and the
operator (or the floor) work: when all fleets are resumed at once (Mission, Services, sensors and workflows), and when
an operator starts that finds all of them evaluated (aggregators). The floor is a client that only sends the same
objects, made beforehand, by server-side apply, 32 at a time as the operator; once before and once after.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import shutil
import statistics
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from bench.measure import Result
from bench.operator_scale.life import Figures, live

COMMAND = "python -m bench.operator --fleets {} --nodes {}{}"
FLEETS = 1000
_MIB = "MiB"


def results(figures: Figures, fleets: int, command: str) -> list[Result]:
    """For people."""
    of = f"{fleets} fleets"
    found = []
    for name, burst in figures.bursts.items():
        floor = ("client that only sends", burst.floor)
        found.append(Result.against(f"operator, {name}, objects applied ({of})", burst.objects, "1/s", floor, command))
        found.append(Result.against(f"operator, {name}, all writes ({of})", burst.writes, "1/s", floor, command))
        found.append(
            Result.against(f"operator, {name}, writes in its busiest 5 s ({of})", burst.busiest, "1/s", floor, command)
        )
    plain = {
        "memory at most, RSS": (figures.peak_mib, _MIB),
        "memory with all fleets at rest, RSS": (figures.rest_rss_mib, _MIB),
        "memory with all fleets at rest, PSS": (figures.rest_pss_mib, _MIB),
        "memory with no fleet, RSS": (figures.empty_mib, _MIB),
        "API calls per fleet at rest": (figures.rest_calls / fleets, "1/min"),
        "API calls of the operator at rest": (figures.rest_calls, "1/min"),
        "processor time at rest": (figures.rest_cpu_s, "s/min"),
        "processor time for a fleet's whole life": (figures.cpu_s / fleets, "s"),
        "API calls for a fleet's whole life": (figures.calls / fleets, "calls"),
        "from nothing to all trained": (figures.trained_s, "s"),
        "from resumed to all done": (figures.done_s, "s"),
        "load average before": (figures.load[0], ""),
        "load average after": (figures.load[1], ""),
    }
    found += [Result(f"operator, {name} ({of})", *value, command=command) for name, value in plain.items()]
    for name, times in figures.effects.items():
        if not times:
            continue
        median, late = statistics.median(times), statistics.quantiles(times, n=20)[-1] if len(times) > 1 else times[0]
        found.append(Result(f"operator, {name}, median of {len(times)} ({of})", median, "s", command=command))
        found.append(Result(f"operator, {name}, 95th percentile ({of})", late, "s", command=command))
    return found


def run(fleets: int = FLEETS, nodes: int = FLEETS, samples: int = 30, pods: bool = True) -> list[Result]:
    memory = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(prefix="fleet-bench-", dir=memory if os.access(memory, os.W_OK) else None))
    try:
        figures = asyncio.run(live(folder, fleets, nodes, samples, pods))
        return results(figures, fleets, COMMAND.format(fleets, nodes, "" if pods else " --without-pods"))
    finally:
        if not os.environ.get("FLEET_BENCH_KEEP"):
            shutil.rmtree(folder)


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fleets", type=int, default=FLEETS)
    parser.add_argument("--nodes", type=int, default=FLEETS)
    parser.add_argument("--samples", type=int, default=30, help="of the time to effect")
    parser.add_argument("--without-pods", action="store_true", help="Jobs are ended by the roles: no KWOK, faster")
    given = parser.parse_args(arguments)
    from rich.console import Console  # noqa: PLC0415 - only here

    from bench.run import table_of  # noqa: PLC0415 - it imports this module by name

    found = run(given.fleets, given.nodes, given.samples, not given.without_pods)
    Console(width=None if sys.stdout.isatty() else 140).print(table_of(found))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

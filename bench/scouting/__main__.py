"""Which plan scouts best, on fields that none of them has seen?

    python -m bench.scouting [--short] [--seeds 10] [--fields ...] [--plans ...] [--agents 4] [--workers 2]
        [--hows nm kr likely] [--against "transects, rows"] [--read FILE]

Prints what each plan needs for 70, 80 and 90 % accuracy, and accuracy at equal energy with paired differences; writes
every curve to bench/out/scouting.json and draws them beside it. With --read it prints what a file of curves says, and
flies nothing. A field that is flown is never among those that a plan
has learned from.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from bench.scouting.aims import BEST_OF, LATTICE, against_best, at_equal_cells, of_fields
from bench.scouting.campaign import Curves, Job, flown, jobs, read, write
from bench.scouting.fields import AIMED, NAMES, REAL
from bench.scouting.judge import How
from bench.scouting.plots import draw
from bench.scouting.registry import plans
from bench.scouting.tables import differences, field_names, means, plan_names, to_goals

OUT = Path(__file__).resolve().parents[1] / "out" / "scouting.json"
SHORT_SEEDS = 2
TOLD = (How.NM, How.KR, How.LIKELY)


def main() -> None:
    """Fly, print and write."""
    arguments = _arguments()
    if arguments.read:
        curves = {job: curve for job, curve in read(arguments.read).items() if _is_wanted(job, arguments)}
        show(curves, Console(width=None if sys.stdout.isatty() else 160), arguments.against, arguments.hows)
        return
    names, places = arguments.plans or list(plans()), arguments.fields or list(REAL if arguments.short else NAMES)
    wanted = jobs(names, places, arguments.agents, arguments.seeds or (SHORT_SEEDS if arguments.short else 10))
    console = Console(width=None if sys.stdout.isatty() else 160)
    start = time.perf_counter()

    def told(done: int, job: Job) -> None:
        if done % 50 == 0 or done == len(wanted):
            print(f"{done} of {len(wanted)}, {time.perf_counter() - start:.0f} s", file=sys.stderr)

    curves = flown(wanted, arguments.workers, told)
    show(curves, console, arguments.against, arguments.hows)
    command = "python -m bench.scouting " + " ".join(sys.argv[1:])
    write(arguments.out, curves, command.strip())
    for how in arguments.hows:
        draw(curves, how, arguments.out.with_name(f"{arguments.out.stem}-{how}.png"))
    console.print(f"{len(curves)} curves in {arguments.out}, and pictures beside it; {command}")


def _is_wanted(job: Job, arguments: argparse.Namespace) -> bool:
    """Whether a curve is of a plan and a field that were asked for; all are when none was."""
    pairs = ((job.plan, arguments.plans), (job.field, arguments.fields))
    return all(name in wanted for name, wanted in pairs if wanted)


def show(curves: Curves, console: Console, against: str, hows: Sequence[How] = TOLD) -> None:
    """Print every table that these curves give."""
    places, names = field_names(curves), plan_names(curves)
    for how in hows:
        for place in places:
            console.print(to_goals(curves, place, how))
        aimed = set(AIMED) <= set(places)
        if aimed:
            console.print(means(curves, how))
        if set(BEST_OF) & set(names):
            console.print(against_best(curves, how))
        if LATTICE in names:
            console.print(at_equal_cells(of_fields(curves, AIMED) if aimed else curves, how))
        if against in names and len(names) > 1:
            console.print(differences(curves, against, AIMED if aimed else places, how))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help=f"{SHORT_SEEDS} seeds, the real fields")
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--fields", nargs="+", choices=NAMES)
    parser.add_argument("--plans", nargs="+", choices=list(plans()))
    parser.add_argument("--agents", type=int, default=4)
    parser.add_argument("--hows", nargs="+", type=How, choices=list(How), default=TOLD, help="maps that are judged")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--against", default="transects, rows", help="the plan that differences are taken to")
    parser.add_argument("--read", type=Path, help="a file of curves, of which tables are printed")
    parser.add_argument("--out", type=Path, default=OUT)
    return parser.parse_args()


if __name__ == "__main__":
    main()

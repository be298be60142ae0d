"""All of the evaluation in one command.

    python -m bench.scouting.everything [--short] [--workers 2]

Runs, one after the other: plans and rivals, sizes of the swarm, stops, the paper's swarm and its parts, learning
between missions, the paper's headline figures, what contexts tell, hovering, late news. The full form takes more than
an hour on two cores, most of it the paper's swarm. The short form takes a few seeds and leaves out what has no short
form; its figures say that everything runs, not more.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time

from bench.scouting import online, paper

SHORT = ((), ("paper",), ("contexts",))
FULL = (
    (),
    ("sizes",),
    ("stops",),
    ("paper",),
    ("online", "--goals", "0.75", "0.85", "0.95"),
    ("headlines", "--paper", str(paper.OUT), "--online", str(online.OUT)),
    ("contexts",),
    ("hover",),
    ("late",),
)
"""Modules of this package and their options; none is the package itself."""


def commands(short: bool, workers: int) -> list[list[str]]:
    """What is run, as arguments of Python."""
    found = []
    for part in SHORT if short else FULL:
        module = ".".join(["bench.scouting", *part[:1]])
        found.append(["-m", module, *part[1:], *(["--short"] if short else []), "--workers", str(workers)])
    return found


def main() -> int:
    """Run all; the exit code says whether anything failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    failed = 0
    for command in commands(arguments.short, arguments.workers):
        started = time.perf_counter()
        done = subprocess.run([sys.executable, *command], check=False)
        failed += done.returncode != 0
        said = "failed" if done.returncode else "done"
        print(f"python {' '.join(command)}: {said} after {time.perf_counter() - started:.0f} s", flush=True)
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())

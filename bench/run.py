"""Runs the benchmarks, prints their figures, and writes them to bench/out/results.json.

    python -m bench.run [names]

A benchmark is a module of this folder with `run() -> list[Result]`.
"""

from __future__ import annotations

import importlib
import json
import sys
import traceback
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.table import Table

from bench.measure import Result

FOLDER = Path(__file__).resolve().parent
OUT = FOLDER / "out" / "results.json"
_NOT_BENCHES = {"measure", "run", "__init__"}


def names() -> list[str]:
    """All benchmarks, by name."""
    files = sorted(path for path in FOLDER.glob("*.py") if path.stem not in _NOT_BENCHES)
    return [path.stem for path in files if "def run(" in path.read_text(encoding="utf-8")]


def run(wanted: Sequence[str], console: Console) -> tuple[list[Result], list[str]]:
    """Results of the benchmarks, and the names of those that failed."""
    results: list[Result] = []
    failed: list[str] = []
    for name in wanted:
        console.print(f"[bold]{name}[/bold]")
        try:
            found: list[Result] = importlib.import_module(f"bench.{name}").run()
        except Exception:  # noqa: BLE001 - one broken benchmark must not cost the figures of the others
            traceback.print_exc()
            failed.append(name)
            continue
        console.print(table_of(found))
        results += found
    return results, failed


def table_of(results: Sequence[Result]) -> Table:
    """Results for people."""
    table = Table("what", "figure", "unit", "peer", "peer's figure", "ratio")
    for column in table.columns:
        column.overflow = "fold"
    for result in results:
        row = [_text(result.value), result.unit, result.peer, _text(result.peer_value), _text(result.ratio)]
        table.add_row(result.name, *row)
    return table


def _text(value: float | None) -> str:
    return "" if value is None else f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def main(arguments: Sequence[str]) -> int:
    """Run benchmarks by name, or all of them."""
    known = names()
    unknown = sorted(set(arguments) - set(known))
    if unknown:
        print(f"no benchmark {', '.join(unknown)}; there are {', '.join(known)}", file=sys.stderr)
        return 2
    console = Console(width=None if sys.stdout.isatty() else 140)
    results, failed = run(list(arguments) or known, console)
    OUT.parent.mkdir(exist_ok=True)
    OUT.write_text(json.dumps([asdict(result) for result in results], indent=2) + "\n", encoding="utf-8")
    console.print(f"{len(results)} figures in {OUT}")
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

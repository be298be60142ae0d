"""What commands say to the user: results on stdout, everything else on stderr, and no colours or bars for machines."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import typer

from fleet.errors import FleetError, Problem, SpecError

Advance = Callable[[int, int], None]
"""Called with what is done and what there is to do."""
_PATIENCE_S = 1.0
"""A bar for less than this only flickers."""


def say(text: str = "") -> None:
    """A line of the result, on stdout."""
    typer.echo(text)


def say_json(document: Any) -> None:
    """The result for machines, on stdout: one JSON document; numbers that are not finite become null."""
    typer.echo(json.dumps(_finite(document), indent=2, ensure_ascii=False, allow_nan=False))


def note(text: str) -> None:
    """A line beside the result, on stderr."""
    typer.echo(text, err=True)


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Rows in columns on stdout: the first column to the left, the others to the right."""
    widths = [max(len(row[column]) for row in (header, *rows)) for column in range(len(header))]
    for number, row in enumerate((header, *rows)):
        cells = [row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))]
        line = "  ".join(cells).rstrip()
        typer.secho(line, bold=number == 0)


def show_error(error: FleetError) -> None:
    """An error for the user, on stderr; a SpecError with every problem."""
    if isinstance(error, SpecError):
        count = len(error.problems)
        headline(f"{error.source or 'the document'} has {count} problem{'s' if count != 1 else ''}")
        for problem in error.problems:
            show_problem(problem, err=True)
    else:
        headline(str(error))


def headline(text: str) -> None:
    """The first line of an error, on stderr."""
    typer.echo(typer.style("error: ", fg=typer.colors.RED, bold=True) + text, err=True)


def show_problem(problem: Problem, err: bool = False) -> None:
    """Where it is, what is wrong, and what to write instead."""
    line = f", line {problem.line}" if problem.line else ""
    typer.echo(f"  {typer.style(problem.path or 'document', bold=True)}{line}: {problem.message}", err=err)
    if problem.hint:
        typer.echo(f"      {problem.hint}", err=err)


@contextmanager
def progress(text: str) -> Iterator[Advance]:
    """A bar on stderr for work that takes longer than a moment; nothing when stderr is not a terminal."""
    if not sys.stderr.isatty():
        yield _silent
        return
    from rich.console import Console  # noqa: PLC0415 - rich is not needed for most commands
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    task = bar.add_task(text, total=None)
    started = time.monotonic()

    def advance(done: int, total: int) -> None:
        bar.update(task, completed=done, total=total)
        if not bar.live.is_started and time.monotonic() - started > _PATIENCE_S:
            bar.start()

    try:
        yield advance
    finally:
        bar.stop()


def _silent(done: int, total: int) -> None:
    """No bar."""


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    if isinstance(value, float) and value - value != 0.0:
        return None
    return value

"""`fleet validate`."""

# ruff: noqa: PLC0415 - imports wait until a command runs, so that --help is quick

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fleet.cli import console
from fleet.errors import ExitCode, Problem


def validate(
    spec: Annotated[Path, typer.Argument(metavar="SPEC", help="The FleetSpec, a YAML file.")],
    as_json: Annotated[bool, typer.Option("--json", help="For machines: valid, problems, warnings.")] = False,
) -> None:
    """Check a FleetSpec and show every problem at once: where, what is wrong, and what to write instead.

    Functions are not called and contexts are not opened. Exit code 2 when there is a problem.

    Example: [bold]fleet validate my-swarm/fleetspec.yaml[/bold]
    """
    from fleet.spec.check import examine

    found = examine(spec)
    if as_json:
        console.say_json(
            {
                "source": str(spec),
                "valid": not found.problems,
                "problems": [_plain(problem) for problem in found.problems],
                "warnings": [_plain(warning) for warning in found.warnings],
            }
        )
    else:
        _show(spec, tuple(found.problems), tuple(found.warnings))
    if found.problems:
        raise typer.Exit(int(ExitCode.USAGE))


def _show(spec: Path, problems: tuple[Problem, ...], warnings: tuple[Problem, ...]) -> None:
    if problems:
        console.say(f"{spec}: {len(problems)} problem{'s' if len(problems) != 1 else ''}")
    for problem in problems:
        console.show_problem(problem)
    for warning in warnings:
        console.note(f"warning: {warning}")
    if not problems:
        console.say(f"{spec} is valid")


def _plain(problem: Problem) -> dict[str, str | int | None]:
    return {"path": problem.path, "line": problem.line or None, "message": problem.message, "hint": problem.hint}

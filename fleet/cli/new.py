"""`fleet init`."""

# ruff: noqa: PLC0415 - imports wait until a command runs, so that --help is quick

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fleet.cli import console


def init(
    name: Annotated[Path, typer.Argument(metavar="NAME", help="Folder to make; its last part names the application.")],
) -> None:
    """Make a new application: a FleetSpec, Map(), Eval(), a test, and two small fields to fly over.

    Nothing is overwritten.

    Example: [bold]fleet init my-swarm[/bold], then [bold]fleet run my-swarm/fleetspec.yaml[/bold]
    """
    from fleet.cli.scaffold.application import make_application

    files = make_application(name)
    console.say(f"made {name}:")
    for file in files:
        console.say(f"  {name / file}")
    console.say()
    console.say(f"next: fleet run {name / 'fleetspec.yaml'}")

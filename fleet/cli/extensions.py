"""Commands that other packages bring, by the entry-point group `fleet.commands`; loaded when they are asked for."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points

import typer

from fleet.cli import console
from fleet.errors import ExitCode

GROUP = "fleet.commands"
EXPECTED = {
    "compile": "Show the objects that would run, as YAML.",
    "files": "Show the files beside a FleetSpec as ConfigMaps, for kubectl apply.",
    "run": "Fly the missions of a FleetSpec on this machine.",
}
"""Commands that users look for though they are in another package, with what they do."""


def names() -> list[str]:
    """Names of all such commands, also of those whose package is missing."""
    return sorted({*EXPECTED, *(point.name for point in entry_points(group=GROUP))})


def application(name: str) -> typer.Typer | None:
    """An application with the command as its only one; None when nobody has such a command.

    A command whose package is missing or broken says so when it is called.
    """
    point = next(iter(entry_points(group=GROUP, name=name)), None)
    if point is None and name not in EXPECTED:
        return None
    app = typer.Typer(add_completion=False)
    if point is None:
        _register_missing(app, name, "its package fleet_operator is not installed; run: pip install fleet-computer")
    else:
        _register(app, point)
    return app


def _register(app: typer.Typer, point: EntryPoint) -> None:
    try:
        function = point.load()
    except Exception as error:  # noqa: BLE001 - the package is not ours; its import may raise anything
        _register_missing(app, point.name, f"{point.value} cannot be loaded: {type(error).__name__}: {error}")
        return
    app.command(point.name)(function)


def _register_missing(app: typer.Typer, name: str, reason: str) -> None:
    """A command that takes whatever it is given and says why it cannot run."""
    text = f"{EXPECTED.get(name, '')} (Not available: {reason}.)".strip()

    @app.command(name, help=text, context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
    def missing() -> None:
        console.headline(f"fleet {name} is not available: {reason}")
        raise typer.Exit(int(ExitCode.PERMANENT))

"""`fleet compile` and `fleet run`."""

# ruff: noqa: PLC0415 - imports wait until a command runs, so that --help is quick

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fleet.cli import console, inputs
from fleet.errors import ExitCode

if TYPE_CHECKING:
    from fleet_operator.local.application import Application

_SpecFile = Annotated[Path, typer.Argument(metavar="SPEC", help="The FleetSpec, a YAML file.")]


def compile_spec(
    spec: _SpecFile,
    storage: Annotated[
        str | None, typer.Option(metavar="URI", help="Storage of the roles; that of the FleetSpec when left out.")
    ] = None,
    image: Annotated[str | None, typer.Option(help="Image with the platform's programs.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="A JSON list of the objects in place of YAML.")] = False,
) -> None:
    """Show the Kubernetes objects that would run, as YAML: all up to the end of the first mission.

    The same FleetSpec and functions give the same bytes. Nothing is started; `fleet run` starts these very objects as
    processes of this machine.

    Example: [bold]fleet compile my-swarm/fleetspec.yaml | less[/bold]
    """
    from fleet_operator.compiler.fleet import compile_fleet, to_yaml
    from fleet_operator.compiler.settings import Settings
    from fleet_operator.compiler.target import Target
    from fleet_operator.flow.orders import neutral_terms
    from fleet_operator.flow.sources import read_bundle

    fleet_spec = inputs.read_spec(spec)
    settings = Settings() if image is None else Settings(runtime_image=image)
    target = Target(fleet_spec, read_bundle(fleet_spec.spec, spec.parent), settings, storage or "")
    objects = compile_fleet(target, neutral_terms(fleet_spec.spec, spec.parent))
    if as_json:
        console.say_json(objects)
    else:
        typer.echo(to_yaml(objects), nl=False)


def run(  # noqa: PLR0913, PLR0917 - one parameter for each option of the command line
    spec: _SpecFile,
    missions: Annotated[
        int | None, typer.Option(min=1, help="Number of missions, in place of the FleetSpec's.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the run; fleet-out/NAME when left out.")
    ] = None,
    storage: Annotated[
        str | None, typer.Option(metavar="URI", help="Storage: file:///folder; the FleetSpec's, or DIR/storage.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of everything random, in place of the FleetSpec's.")
    ] = None,
    context: Annotated[
        list[str] | None, typer.Option(metavar="NAME=DIR", help="Fly or learn over another folder; may be repeated.")
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Remove the run that is in DIR, and begin anew.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="The result for machines, on stdout.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing until the end.")] = False,
) -> None:
    """Fly the missions of a FleetSpec on this machine: shape, train, fly, retrain, and report.

    Every role is a process of its own, started from the objects that [bold]fleet compile[/bold] shows. Ctrl-C stops
    all of them; the same command goes on from there. Logs are in DIR/logs, the report is DIR/report.html.

    Exit code 0 when the last mission met every goal, 1 when it missed one.

    Example: [bold]fleet run my-swarm/fleetspec.yaml --missions 2 --context field=data/other-field[/bold]
    """
    from fleet_operator.local.display import open_display
    from fleet_operator.local.outcome import exit_code, show, to_json
    from fleet_operator.local.service import run_fleet

    application = _application(spec, missions, out, storage, seed, context or [])
    try:
        summary = run_fleet(application, open_display(quiet or as_json), fresh)
    except KeyboardInterrupt as error:
        console.note(f"interrupted; the same command goes on from here (the run is in {application.out})")
        raise typer.Exit(int(ExitCode.INTERRUPTED)) from error
    if as_json:
        console.say_json(to_json(summary))
    else:
        show(summary)
    raise typer.Exit(int(exit_code(summary)))


def _application(
    file: Path, missions: int | None, out: Path | None, storage: str | None, seed: int | None, context: list[str]
) -> Application:
    from fleet.storage.open import open_storage
    from fleet_operator.flow.sources import read_bundle
    from fleet_operator.local.application import Application, with_changes

    spec = with_changes(inputs.read_spec(file), missions, seed)
    folder = out or Path("fleet-out") / spec.name
    place = open_storage(inputs.storage_uri(spec, folder, storage))
    return Application(spec, file, folder, place, read_bundle(spec.spec, file.parent), inputs.read_overrides(context))

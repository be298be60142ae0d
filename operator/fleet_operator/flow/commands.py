"""`fleet files`."""

# ruff: noqa: PLC0415 - imports wait until a command runs, so that --help is quick

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fleet.cli import console, inputs


def files(
    spec: Annotated[Path, typer.Argument(metavar="SPEC", help="The FleetSpec, a YAML file.")],
    namespace: Annotated[
        str | None,
        typer.Option("--namespace", "-n", help="Namespace of the FleetSpec; kubectl's when it names none."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="A JSON list of the objects in place of YAML.")] = False,
) -> None:
    """Show the ConfigMaps that bring the files beside a FleetSpec into a cluster: functions, profiles, contexts.

    The operator finds them by their label. The same files give the same bytes.

    Example: [bold]fleet files my-swarm/fleetspec.yaml | kubectl apply --server-side -f -[/bold]
    """
    from fleet_operator.compiler.fleet import to_yaml
    from fleet_operator.flow.files import collect, to_config_maps

    fleet = inputs.read_spec(spec)
    objects = to_config_maps(fleet.name, collect(fleet, spec.parent))
    named = namespace or (fleet.metadata.namespace if "namespace" in fleet.metadata.model_fields_set else None)
    for manifest in objects:
        if named is not None:
            manifest["metadata"]["namespace"] = named
    if as_json:
        console.say_json(objects)
    else:
        typer.echo(to_yaml(objects), nl=False)

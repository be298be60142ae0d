"""`fleet serve`: a user function as a small HTTP server."""

# ruff: noqa: PLC0415 - imports wait until a command runs, so that --help is quick

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import typer


class Kind(StrEnum):
    """Which of the two functions."""

    MAP = "map"
    EVAL = "eval"


PORTS = {Kind.MAP: 8081, Kind.EVAL: 8082}
"""Ports that an AS workflow looks for its functions at."""


def serve(
    kind: Annotated[Kind, typer.Argument(help="Which contract to serve.")],
    function: Annotated[str, typer.Argument(metavar="MODULE:FUNCTION", help="The function; its module is imported.")],
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int | None, typer.Option(help="Port; 8081 for map and 8082 for eval when left out.")] = None,
    timeout: Annotated[str, typer.Option(help="A call that takes longer is answered with an error.")] = "60s",
) -> None:
    """Serve Map() or Eval() over HTTP, until it is stopped.

    The module is looked for in the current folder and on PYTHONPATH.

    Example: [bold]fleet serve map my_swarm:map_observation --port 8081[/bold]
    """
    from fleet.functions.http_server import serve_function
    from fleet.spec.base import duration_s

    try:
        timeout_s = duration_s(timeout)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--timeout") from error
    sys.path.insert(0, str(Path.cwd()))
    contract: Literal["Map", "Eval"] = "Map" if kind is Kind.MAP else "Eval"
    serve_function(contract, function, host, PORTS[kind] if port is None else port, timeout_s)

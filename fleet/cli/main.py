"""The `fleet` application: which commands there are, and how errors become messages and exit codes."""

# ruff: noqa: PLC0415 - imports wait until a command runs, so that --help is quick

from __future__ import annotations

import os
import sys
import traceback
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import fleet
from fleet.cli import console, contexts, explaining, extensions, learn, new, reporting, serving, simulate, validate
from fleet.errors import ExitCode, FleetError

_ORDER = [
    "init",
    "validate",
    "compile",
    "run",
    "report",
    "explain",
    "simulate",
    "shape",
    "train",
    "context",
    "serve",
    "version",
]
_BROKEN_PIPE = 141
"""What a shell says of a program that SIGPIPE ended."""


class FleetGroup(TyperGroup):
    """A group that also has the commands of other packages, and that says what went wrong in plain words."""

    def list_commands(self, ctx: Any) -> list[str]:
        """All commands, in the order in which one needs them."""
        names = dict.fromkeys([*super().list_commands(ctx), *extensions.names()])
        return sorted(names, key=lambda name: _ORDER.index(name) if name in _ORDER else len(_ORDER))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A command by name; those of other packages are imported here."""
        if cmd_name not in self.commands:
            application = extensions.application(cmd_name)
            if application is not None:
                self.add_command(typer.main.get_command(application), cmd_name)
        return super().get_command(ctx, cmd_name)

    def invoke(self, ctx: Any) -> Any:
        """Run the command; see `exit_code_of`."""
        try:
            return super().invoke(ctx)
        except (FleetError, OSError, KeyboardInterrupt) as error:
            if ctx.params.get("debug"):
                traceback.print_exc()
            raise typer.Exit(exit_code_of(error)) from error


def exit_code_of(error: FleetError | OSError | KeyboardInterrupt) -> int:
    """Say on stderr what went wrong; the exit code that tells a supervisor whether to try again."""
    match error:
        case FleetError():
            console.show_error(error)
            return int(error.exit_code)
        case BrokenPipeError():
            _discard_output()
            return _BROKEN_PIPE
        case FileExistsError() | NotADirectoryError():
            console.headline(f"{error.filename}: there is a file where a folder is needed; name another")
            return int(ExitCode.USAGE)
        case OSError():
            console.headline(": ".join(str(part) for part in (error.filename, error.strerror or error) if part))
            amiss = isinstance(error, FileNotFoundError | IsADirectoryError | PermissionError)
            return int(ExitCode.USAGE if amiss else ExitCode.TRANSIENT)
        case _:
            console.headline("interrupted")
            return int(ExitCode.INTERRUPTED)


app = typer.Typer(
    name="fleet",
    cls=FleetGroup,
    no_args_is_help=True,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        console.say(f"fleet {fleet.__version__}")
        raise typer.Exit


@app.callback()
def root(
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
    version_wanted: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """Swarms of autonomous systems from two functions and a FleetSpec.

    Start with [bold]fleet init my-swarm[/bold], then [bold]fleet run my-swarm/fleetspec.yaml[/bold].

    Exit codes: 0 all is well, 1 a mission missed a goal, 2 the input is wrong, 65 the same input will fail again,
    75 trying again may help, 130 interrupted.
    """


def version(as_json: Annotated[bool, typer.Option("--json", help="For machines.")] = False) -> None:
    """Show the versions of fleet and of what it computes with.

    Example: [bold]fleet version --json[/bold]
    """
    import platform
    from importlib.metadata import PackageNotFoundError
    from importlib.metadata import version as installed

    versions = {"fleet": fleet.__version__, "python": platform.python_version()}
    for package in ("numpy", "numba", "scipy", "scikit-optimize", "opencv-python-headless", "pydantic", "pyarrow"):
        try:
            versions[package] = installed(package)
        except PackageNotFoundError:
            versions[package] = "not installed"
    if as_json:
        console.say_json(versions)
        return
    console.table(("package", "version"), list(versions.items()))


app.command("init")(new.init)
app.command("validate")(validate.validate)
app.command("simulate")(simulate.simulate)
app.command("shape")(learn.shape)
app.command("train")(learn.train)
app.command("report")(reporting.report)
app.command("explain")(explaining.explain)
app.add_typer(contexts.app, name="context")
app.command("serve")(serving.serve)
app.command("version")(version)


def run() -> None:
    """The console script."""
    try:
        try:
            app(prog_name="fleet")
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        _discard_output()
        sys.exit(_BROKEN_PIPE)
    except Exception:  # noqa: BLE001 - the last resort: a fault of ours must not end with the code of a missed goal
        traceback.print_exc()
        console.headline("this is a fault in fleet, not in your input; the lines above say where")
        sys.exit(int(ExitCode.PERMANENT))


def _discard_output() -> None:
    """Nobody reads stdout any more: what is still buffered must not raise once more at the end of the process."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

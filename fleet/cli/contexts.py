"""`fleet context import|check|show`."""

# ruff: noqa: PLC0415 - imports wait until a command runs, so that --help is quick

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fleet.cli import console
from fleet.errors import ContextError, ExitCode, Problem, SpecError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fleet.contexts.base import Media
    from fleet.contexts.check import ContextReport, Statistics

app = typer.Typer(no_args_is_help=True, help="Contexts: places that are completely known, to learn from and fly over.")
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the context.")]
AsJson = Annotated[bool, typer.Option("--json", help="For machines.")]


@app.command("import")
def import_(  # noqa: PLR0913, PLR0917 - the options of a command
    table: Annotated[Path, typer.Argument(metavar="TABLE", exists=True, dir_okay=False, help="A CSV file.")],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to make; its name is the context's name.")],
    date: Annotated[str, typer.Option(help="Date of all lines: 2018, 2018-06 or 2018-06-01.")] = "",
    truth: Annotated[str, typer.Option(help="Column that missions are to map; exg or yield when left out.")] = "",
    feature: Annotated[list[str] | None, typer.Option(help="Column to import; all when left out. Repeatable.")] = None,
    where: Annotated[
        list[str] | None, typer.Option(metavar="COLUMN=TEXT", help="Import such lines only. Repeatable.")
    ] = None,
    pictures: Annotated[
        Path | None, typer.Option(exists=True, file_okay=False, help="Folder of the pictures that TABLE names.")
    ] = None,
    cell_height: Annotated[float | None, typer.Option(min=0.01, help="Height of a cell, in m.")] = None,
    cell_width: Annotated[float | None, typer.Option(min=0.01, help="Width of a cell, in m.")] = None,
    source: Annotated[str, typer.Option(help="Where the data comes from.")] = "",
    licence: Annotated[str, typer.Option(help="Licence of the data.")] = "",
) -> None:
    """Make a context of a table of measurements or pictures.

    A table with row and col is taken as it is; one with lat and lon only is gridded. Several lines of a cell are
    averaged, and cells without a line stay empty. A yield monitor's table gets its yield from the grain flow.

    Example: [bold]fleet context import june.csv contexts/june --date 2018-06-01[/bold]
    """
    from fleet.contexts.files import write_cube
    from fleet.contexts.importing import ImportOptions, import_file
    from fleet.storage.local import LocalStorage

    _check_target(folder)
    options = ImportOptions(
        name=folder.absolute().name,
        date=date,
        truth=truth,
        source=source,
        licence=licence,
        cell_height_m=cell_height,
        cell_width_m=cell_width,
        features=tuple(feature or ()),
        where=_pairs(where or []),
    )
    imported = import_file(table, options, pictures, _measure)
    write_cube(imported.content, LocalStorage(folder))
    for remark in imported.notes:
        console.note(remark)
    console.say(f"made {folder}; look at it: fleet context show {folder}")


@app.command()
def check(folder: Folder, as_json: AsJson = False) -> None:
    """Say whether a context is a good one: every problem at once, warnings, and what it holds.

    Exit code 2 when there is a problem.

    Example: [bold]fleet context check my-swarm/contexts/field[/bold]
    """
    from fleet.contexts.check import check_context
    from fleet.storage.local import LocalStorage

    found = check_context(LocalStorage(folder))
    if as_json:
        console.say_json({**asdict(found), "good": found.is_good})
    else:
        _show_report(folder, found)
    if not found.is_good:
        raise typer.Exit(int(ExitCode.USAGE))


@app.command()
def show(
    folder: Folder,
    date: Annotated[str | None, typer.Option(help="Date to show; the last one when left out.")] = None,
    feature: Annotated[str | None, typer.Option(help="Quantity to draw; the truth when left out.")] = None,
    picture: Annotated[
        Path | None, typer.Option(help="PNG file to write; NAME.png in this folder when left out.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show the statistics of a context, and draw a map of it.

    Example: [bold]fleet context show my-swarm/contexts/field --picture field.png[/bold]
    """
    from fleet.contexts.check import statistics_of
    from fleet.contexts.load import load_cube
    from fleet.report import figures, plots
    from fleet.storage.local import LocalStorage

    cube = load_cube(LocalStorage(folder))
    cube = cube.at(date) if date else cube
    quantity = feature or cube.manifest.truth or next(iter(cube.manifest.feature_names), "")
    if not quantity:
        raise ContextError(f"{folder}: the context has no features to draw")
    values = cube.values(quantity)
    unit = {one.name: one.unit for one in cube.manifest.features}[quantity]
    scale = figures.value_scale(f"{quantity} ({unit})" if unit else quantity, [values])
    file = picture or Path(f"{cube.manifest.name}.png")
    file.write_bytes(plots.value_map(cube.environment.grid, values, scale))
    statistics = statistics_of(cube)
    if as_json:
        console.say_json({**asdict(statistics), "picture": str(file)})
        return
    _show_statistics(statistics)
    console.say(f"map of {quantity}: {file}")


def _show_report(folder: Path, found: ContextReport) -> None:
    if found.problems:
        console.say(f"{folder} is not a good context:")
        for problem in found.problems:
            console.show_problem(problem)
    for warning in found.warnings:
        console.note(f"warning: {warning}")
    for statistics in found.statistics:
        _show_statistics(statistics)
        console.say()
    if found.is_good:
        console.say(f"{folder} is a good context")


def _show_statistics(statistics: Statistics) -> None:
    share = f"{statistics.coverage:.0%}"
    console.say(f"{statistics.name} ({statistics.kind}), {statistics.date}")
    console.say(
        f"{statistics.rows} rows x {statistics.columns} columns; {statistics.with_data} of {statistics.cells} cells "
        f"({share}) have data; pictures are {'drawn from the features' if statistics.rendered else 'stored'}"
    )
    if statistics.correlation_m is not None:
        console.say(f"the truth's correlation length is {statistics.correlation_m:.0f} m")
    rows = [
        (one.name, one.unit, *(f"{value:.4g}" for value in (one.minimum, one.mean, one.maximum)), str(one.missing))
        for one in statistics.features
    ]
    console.table(("feature", "unit", "least", "mean", "greatest", "missing"), rows)


def _check_target(folder: Path) -> None:
    from fleet.spec.base import NAME_PATTERN

    problems, name = [], folder.absolute().name
    if re.fullmatch(NAME_PATTERN, name) is None or len(name) > 40:
        hint = "use at most 40 small letters, digits and `-`, such as june-2018"
        problems.append(Problem("DIR", f"{name!r} is not a name for a context", hint))
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        problems.append(Problem("DIR", f"{folder} is there already", "nothing was changed; choose another folder"))
    if problems:
        raise SpecError(problems, "the command line")


def _pairs(texts: Sequence[str]) -> dict[str, str]:
    pairs = [text.partition("=") for text in texts]
    wrong = [text for text, (_, sign, _) in zip(texts, pairs, strict=True) if not sign]
    if wrong:
        problems = [Problem("--where", f"{text!r} is not COLUMN=TEXT", "write --where year=2001") for text in wrong]
        raise SpecError(problems, "the command line")
    return {column: wanted for column, _, wanted in pairs}


def _measure(media: Media) -> Mapping[str, float]:
    """Excess green and brightness of a picture: what the features of pictures are when the table has none."""
    from fleet.contexts.base import Observation
    from fleet.functions.compose import compose
    from fleet.functions.extractors import brightness, excess_green

    seen: dict[str, Any] = compose(excess_green, brightness)(Observation(0, "a picture", (media,)))
    return seen

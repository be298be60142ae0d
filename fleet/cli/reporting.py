"""`fleet report`."""

# ruff: noqa: PLC0415 - imports wait until a command runs, so that --help is quick

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fleet.cli import console, runs

if TYPE_CHECKING:
    from fleet.report.collect import RunData


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a run: what --out of fleet run named.")],
    storage: Annotated[
        str | None, typer.Option(help="Folder or address of the run's storage, when it is not in DIR.")
    ] = None,
    fleet: Annotated[str | None, typer.Option(help="NAMESPACE/NAME, when the storage has several fleets.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the report; DIR when left out.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="For machines: the missions and their metrics.")] = False,
) -> None:
    """Write report.html, pictures, trace.csv and map.csv of a run, finished or broken off.

    Example: [bold]fleet report out/my-swarm[/bold]
    """
    from fleet.report.collect import collect
    from fleet.report.html import missions_table, shaping_sentence, verdict
    from fleet.report.write import write

    place = runs.storage_of(folder, storage)
    run = collect(place, runs.fleet_in(place, fleet))
    page = write(run, out or folder)
    if as_json:
        console.say_json({"report": str(page), "missions": _missions(run), "notes": list(run.notes)})
        return
    console.say(verdict(run))
    if run.missions:
        console.table(missions_table(run).header, missions_table(run).rows)
    if run.reward is not None and not run.reward.goals_met:
        console.say(shaping_sentence(run))
    for remark in run.notes:
        console.note(f"warning: {remark}")
    console.say(f"report: {page}")


def _missions(run: RunData) -> list[dict[str, object]]:
    return [
        {
            "number": mission.number,
            "context": mission.context,
            "over": mission.evaluation is not None,
            "metrics": mission.evaluation.metrics if mission.evaluation else {},
            "goals_met": mission.evaluation.goals_met if mission.evaluation else False,
            "failures": mission.failures,
        }
        for mission in run.missions
    ]

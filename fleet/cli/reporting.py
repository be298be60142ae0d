"""`fleet report`."""

# ruff: noqa: PLC0415 - imports wait until a command runs, so that --help is quick

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fleet.cli import console, inputs
from fleet.errors import Problem, SpecError

if TYPE_CHECKING:
    from fleet.report.collect import RunData
    from fleet.storage.layout import FleetPaths
    from fleet.storage.port import Storage

SPEC_NAME = "fleet.json"


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
    from fleet.storage.open import open_storage

    place = open_storage(inputs.as_uri(storage)) if storage else _storage_in(folder)
    run = collect(place, _fleet_in(place, fleet))
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


def _storage_in(folder: Path) -> Storage:
    """The storage of a run: its folder `storage`, where its run.json says, or the folder itself."""
    from fleet.storage.local import LocalStorage
    from fleet.storage.open import open_storage

    if not folder.is_dir():
        problem = Problem("DIR", f"there is no folder {folder}", "name the folder of a run")
        raise SpecError([problem], "the command line")
    if (folder / "storage").is_dir():
        return LocalStorage(folder / "storage")
    ledger = folder / "run.json"
    return open_storage(json.loads(ledger.read_bytes())["storageUri"]) if ledger.is_file() else LocalStorage(folder)


def _fleet_in(storage: Storage, wanted: str | None) -> FleetPaths:
    """The fleet that is wanted, or the only one that the storage has."""
    from fleet.storage.layout import FleetPaths

    found = sorted(
        tuple(entry.path.split("/")[:2])
        for entry in storage.list("")
        if entry.path.count("/") == 2 and entry.path.endswith(f"/{SPEC_NAME}")
    )
    names = ["/".join(parts) for parts in found]
    if wanted is not None and wanted in names:
        return FleetPaths(*wanted.split("/"))
    if wanted is None and len(found) == 1:
        return FleetPaths(*found[0])
    if not found:
        hint = "name the folder that fleet run wrote, or --storage"
        problem = Problem("DIR", f"there is no run in {storage.uri}", hint)
    else:
        message = f"there is no fleet {wanted}" if wanted else "the storage has several fleets"
        problem = Problem("--fleet", message, f"choose one of {', '.join(names)}")
    raise SpecError([problem], "the command line")


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

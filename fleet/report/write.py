"""The report of a run as files: report.html, PNGs, trace.csv, map.csv."""

from __future__ import annotations

from pathlib import Path

from fleet.report import html, pictures
from fleet.report.collect import RunData, collect
from fleet.report.pictures import Picture
from fleet.report.tables import map_csv, trace_csv
from fleet.storage.layout import FleetPaths
from fleet.storage.port import Storage


def write_report(storage: Storage, paths: FleetPaths, out: Path) -> Path:
    """Write the report of a finished, broken-off or empty run.

    Args:
        storage, paths: Where the run is.
        out: Folder of the report; made when it is not there. Files of an earlier report are replaced.
    Returns:
        report.html. Beside it: trace.csv, map.csv (the last mission), missions/NNNN/map.csv and the pictures.
    Raises:
        StorageError: the storage does not answer.
        OSError: the folder cannot be written.
    """
    return write(collect(storage, paths), out)


def write(run: RunData, out: Path) -> Path:
    """Write the report of a run that was collected; see `write_report`."""
    out.mkdir(parents=True, exist_ok=True)
    _put(out / "trace.csv", trace_csv(run.missions).encode())
    for mission in run.missions:
        _put(out / "missions" / f"{mission.number:04d}" / "map.csv", map_csv(mission).encode())
    if run.missions:
        _put(out / "map.csv", map_csv(run.missions[-1]).encode())
    placed = _pictures(run)
    for picture in (one for group in placed.values() for one in group):
        _put(out / picture.path, picture.png)
    return _put(out / "report.html", html.render(run, placed).encode())


def _pictures(run: RunData) -> dict[str, tuple[Picture, ...]]:
    models = pictures.models_picture(run)
    reward = [one for one in (pictures.reward_picture(run), pictures.trials_picture(run)) if one is not None]
    return {
        "metrics": pictures.metric_pictures(run),
        "models": (models,) if models else (),
        "reward": tuple(reward),
        **{
            f"mission {one.number}": (*pictures.mission_pictures(one), *pictures.claims_pictures(run, one))
            for one in pictures.pictured(run.missions)
        },
    }


def _put(file: Path, data: bytes) -> Path:
    """Replace a file at once: who reads it sees the old one or the new one."""
    file.parent.mkdir(parents=True, exist_ok=True)
    temporary = file.with_name(f"{file.name}.new")
    temporary.write_bytes(data)
    return temporary.replace(file)

"""Make the contexts beside this file from the corn cube: `python make_contexts.py FOLDER/corn-cube`."""

from __future__ import annotations

import sys
from pathlib import Path

from fleet.contexts.files import write_cube
from fleet.contexts.importing import ImportOptions, import_file
from fleet.storage.local import LocalStorage

HERE = Path(__file__).resolve().parent
DATES = ("2018-06-01", "2018-08-02", "2018-09-16")
FEATURES = (
    "lat", "lon", "exg", "lai", "brightness", "saturation_red", "saturation_green", "saturation_blue",
    "exposure_s", "day_fraction",
)  # fmt: skip


def options(date: str) -> ImportOptions:
    """What the CSV of a date does not say."""
    return ImportOptions(
        name=f"field-{date}",
        date=date,
        description="A corn field in Ohio from above: features of UAV pictures, averaged over each cell.",
        source="public repository boubinjg/SoftwarePilot, reduced to features of each picture; see NOTICE",
        licence="MIT",
        rows=56,
        columns=44,
        features=FEATURES,
    )


def main(folder: Path) -> None:
    """Import all dates."""
    for date in DATES:
        imported = import_file(folder / f"{date}.csv", options(date))
        write_cube(imported.content, LocalStorage(HERE / date))
        sys.stdout.write(f"{date}: {'; '.join(imported.notes)}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))

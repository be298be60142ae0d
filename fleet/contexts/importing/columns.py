"""Which columns of a table become features, and what is known of them."""

from __future__ import annotations

import re
from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.importing.sheet import VERDICT, Sheet
from fleet.contexts.manifest import KEYS, BrokenContext, FeatureSpec
from fleet.errors import Problem

_KNOWN = {
    spec.name: spec
    for spec in (
        FeatureSpec(name="exg", unit="grey levels", description="Excess green: mean of 2G - R - B over a picture."),
        FeatureSpec(name="lai", unit="1", description="Leaf area of a picture, as its source measures it."),
        FeatureSpec(name="cover", unit="1", description="Share of a picture that is plants."),
        FeatureSpec(name="brightness", unit="1", description="Mean brightness of a picture, 1 is white."),
        FeatureSpec(name="saturation_red", unit="1", description="Mean red of a picture, 1 is full."),
        FeatureSpec(name="saturation_green", unit="1", description="Mean green of a picture, 1 is full."),
        FeatureSpec(name="saturation_blue", unit="1", description="Mean blue of a picture, 1 is full."),
        FeatureSpec(name="exposure_s", unit="s", description="Exposure time.", attribute=True),
        FeatureSpec(name="day_fraction", unit="d", description="Time of the day; 0.5 is noon.", attribute=True),
        FeatureSpec(name="lat", unit="deg", description="Latitude of the camera.", attribute=True),
        FeatureSpec(name="lon", unit="deg", description="Longitude of the camera.", attribute=True),
        FeatureSpec(name="yield", description="Harvested crop of an area."),
        FeatureSpec(name="moist", unit="%", description="Moisture of the grain."),
        FeatureSpec(name="elev", description="Height of the ground."),
    )
}
_SAME = {"latitude": "lat", "long": "lon", "lng": "lon", "longitude": "lon"}
TRUTHS = ("exg", "yield")
"""What missions map when the user names nothing else, the first that is there."""


def choose_features(
    sheet: Sheet, wanted: Collection[str], used: Collection[str]
) -> tuple[dict[str, NDArray[np.float64]], list[str]]:
    """The columns of numbers that become features.

    Args:
        sheet: The table; fields that are no numbers become its problems.
        wanted: Names of columns; every column of numbers when empty.
        used: Columns that have another use.

    Returns:
        Values by name, and notes for the user.

    Raises:
        BrokenContext: a wanted column is not there.
    """
    absent = [name for name in wanted if name not in sheet.header]
    if absent:
        hint = f"the table has {', '.join(sheet.header)}"
        raise BrokenContext(sheet.where, [Problem(name, "there is no such column", hint) for name in absent], VERDICT)
    candidates = [name for name in sheet.header if name not in used and name not in KEYS]
    chosen = [name for name in candidates if name in wanted] if wanted else candidates
    text = [name for name in chosen if name not in wanted and not sheet.is_numeric(name)]
    notes = [f"columns that hold no numbers were left out: {', '.join(text)}"] if text else []
    values = {identifier(name): sheet.floats(name) for name in chosen if name not in text}
    for name, numbers in values.items():
        missing = int(np.count_nonzero(np.isnan(numbers)))
        if missing:
            notes.append(f"{name} is missing in {missing} of {len(numbers)} lines")
    return values, notes


def choose_truth(truth: str, features: Collection[str], where: str) -> str:
    """The name of the feature that missions map.

    Raises:
        BrokenContext: the named one is not there, or none is named and none is known.
    """
    name = identifier(truth) if truth else next((known for known in TRUTHS if known in features), "")
    if name not in features:
        message = f"there is no column of numbers {truth!r}" if truth else "is not given"
        hint = f"choose one of {', '.join(features)}" if features else "the table has no column of numbers"
        raise BrokenContext(where, [Problem("truth", message, hint)], VERDICT)
    return name


def describe(name: str) -> FeatureSpec:
    """What is known of a feature by its name."""
    return _KNOWN.get(name, FeatureSpec(name=name))


def identifier(column: str) -> str:
    """A column's name as a feature's: letters, digits and `_`; positions are always `lat` and `lon`."""
    if column.lower() in _SAME:
        return _SAME[column.lower()]
    name = re.sub(r"\W+", "_", column, flags=re.ASCII).strip("_")
    if not name:
        return "feature"
    return name[:63] if not name[0].isdigit() else f"_{name}"[:63]

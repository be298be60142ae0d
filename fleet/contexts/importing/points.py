"""Import of located points, such as those of a yield monitor, onto a grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.importing.assemble import Located, Orientation, assemble, metres
from fleet.contexts.importing.columns import choose_features, choose_truth
from fleet.contexts.importing.options import DEFAULT_CELL_M, Imported, ImportOptions
from fleet.contexts.importing.sheet import VERDICT, Sheet, read_sheet
from fleet.contexts.importing.table import LAT, LON
from fleet.contexts.manifest import BrokenContext, FeatureSpec
from fleet.errors import Problem

FLOW = ("mass", "seconds", "dist", "moist")
"""Columns of a yield monitor: pounds of grain a second, seconds, inches, % of moisture."""
_BUSHEL_LB, _DRY_MOISTURE, _INCHES_PER_M, _SQUARE_INCHES_PER_ACRE = 56.0, 15.5, 39.3701, 6_272_640.0
_MAD_TO_SD = 1.4826


def import_points(text: str, options: ImportOptions, where: str = "the points") -> Imported:
    """Make a cube of points with `lat` and `lon`: points of a cell are averaged, empty cells stay empty.

    Row 0 is the most northern, column 0 the most western. Without a column `yield`, the columns of a yield monitor
    (`mass`, `seconds`, `dist`, `moist`) give it; see `yield_from_flow`. Points with an outlying truth are left out.

    Args:
        text: The table with its header.
        options: What the table does not say.
        where: Name of the source, for messages.

    Raises:
        BrokenContext: lists every bad line with its number, column and what to write.
    """
    sheet, notes = read_sheet(text, where, options.where)
    lat, lon = read_degrees(sheet)
    date = sheet.find("date")
    dates = sheet.dates(date, options.date)
    features, described, more = _features(sheet, options, {*options.where, *([date] if date else [])})
    sheet.check()
    truth = choose_truth(options.truth, features, where)
    kept, dropped = inliers(features[truth], options.outliers)
    if not kept.any():
        problem = Problem(truth, "no point has a value", "write numbers into that column")
        raise BrokenContext(where, [problem], VERDICT)
    if dropped:
        more.append(f"{dropped} points with an outlying {truth}, or none, were left out")
    rows, columns, orientation = grid_points(lat[kept], lon[kept], options)
    chosen = {name: values[kept] for name, values in features.items()}
    located = Located(rows, columns, dates[kept], chosen, orientation, truth, described=described)
    content = assemble(located, options, where)
    more.append(f"{int(kept.sum())} points averaged to {len(content.cells)} cells")
    return Imported(content, (*notes, *more))


def grid_points(
    lat: NDArray[np.float64], lon: NDArray[np.float64], options: ImportOptions
) -> tuple[NDArray[np.int64], NDArray[np.int64], Orientation]:
    """Rows and columns of positions in degrees; row 0 is the most northern, column 0 the most western."""
    height, width = options.cell_height_m or DEFAULT_CELL_M, options.cell_width_m or DEFAULT_CELL_M
    north, east = metres(lat, lon)
    rows = np.floor((north.max() - north) / height).astype(np.int64)
    columns = np.floor(east / width).astype(np.int64)
    return rows, columns, Orientation(height, width)


def yield_from_flow(flow: NDArray[np.float64], swath_m: float) -> NDArray[np.float64]:
    """Dry yield in bushels an acre, from what a yield monitor measures; NaN where the harvester did not move.

    Args:
        flow: Columns of FLOW, float64 [n, 4].
        swath_m: Width of the cut.

    Source: documentation of gartner.corn in agridat: dry grain at 15.5 % moisture and 56 pounds a bushel, over distance
        times swath.
    """
    mass, seconds, dist, moist = flow.T
    bushels = mass * seconds * (100 - moist) / (100 - _DRY_MOISTURE) / _BUSHEL_LB
    acres = dist * swath_m * _INCHES_PER_M / _SQUARE_INCHES_PER_ACRE
    return np.asarray(np.divide(bushels, acres, out=np.full(len(flow), np.nan), where=acres > 0), dtype=np.float64)


def inliers(values: NDArray[np.float64], limit: float) -> tuple[NDArray[np.bool_], int]:
    """Which values are known and within some robust standard deviations (1.4826 x MAD) of the median.

    Returns:
        Which to keep, bool [n], and how many are not.
    """
    kept = np.isfinite(values)
    if kept.any() and limit > 0:
        distance = np.abs(values - np.median(values[kept]))
        scale = _MAD_TO_SD * float(np.median(distance[kept]))
        if scale > 0:
            kept &= np.where(kept, distance, np.inf) <= limit * scale
    return kept, int(len(values) - kept.sum())


def read_degrees(sheet: Sheet) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Latitude and longitude of every line, in degrees; what is none becomes a problem of its line.

    Raises:
        BrokenContext: the table has no such columns.
    """
    lat, lon = sheet.find(*LAT), sheet.find(*LON)
    if lat is None or lon is None:
        hint = f"give columns lat and lon in degrees; the table has {', '.join(sheet.header)}"
        raise BrokenContext(sheet.where, [Problem("header", "says not where the lines are", hint)], VERDICT)
    return _degrees(sheet, lat, 90), _degrees(sheet, lon, 180)


def _features(
    sheet: Sheet, options: ImportOptions, used: set[str]
) -> tuple[dict[str, NDArray[np.float64]], dict[str, FeatureSpec], list[str]]:
    """Values by name, what is known of those that were computed, and notes."""
    used = used | {name for name in (sheet.find(*LAT), sheet.find(*LON)) if name}
    flow = _flow(sheet, options)
    if flow is None:
        features, notes = choose_features(sheet, options.features, used)
        return features, {}, notes
    used |= {name for name in (*FLOW[:3], "time") if name not in options.features}
    features, notes = choose_features(sheet, [name for name in options.features if name != "yield"], used)
    dry = yield_from_flow(flow, options.swath_m)
    spec = FeatureSpec(name="yield", unit="bu/ac", description="Dry grain, from its flow.")
    return {**features, "yield": dry}, {"yield": spec}, notes


def _flow(sheet: Sheet, options: ImportOptions) -> NDArray[np.float64] | None:
    """What yield is computed from, [n, 4], when the table has it but no yield itself."""
    names = [name for name in map(sheet.find, FLOW) if name is not None]
    if len(names) < len(FLOW) or sheet.find("yield") is not None or options.truth not in {"", "yield"}:
        return None
    return np.stack([sheet.floats(name) for name in names], axis=1)


def _degrees(sheet: Sheet, column: str, limit: float) -> NDArray[np.float64]:
    values = sheet.floats(column, required=True)
    texts = sheet.texts(column)
    for index in np.flatnonzero(np.abs(values) > limit).tolist():
        sheet.blame(index, column, texts[index], f"write degrees from -{limit:.0f} to {limit:.0f}")
    return values

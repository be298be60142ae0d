"""trace.csv and map.csv: the results of missions for other programs.

trace.csv has one line for each state that an agent visited, in order, the take-off cell first. `row` and `col` are
those of the context's source, `captured` is 0 or 1, `action` is the move that left the state, or `Land`. `t_s` is
the mission time on arrival. `energy_j` is what this agent's aircraft has spent in the mission so far, from take-off
up to and including the capture in this state: it grows from line to line.

map.csv has one line for each cell with data, row by row. A field is empty where a value is not known. `visited` is 1
when some agent was in the cell; trace.csv says whether it captured it.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from fleet.report.collect import MissionRun

TRACE_HEADER = ("mission", "agent", "step", "t_s", "row", "col", "captured", "action", "energy_j")
MAP_HEADER = ("row", "col", "truth", "predicted", "class", "visited")
PREDICTED, CLASS = "predicted", "class"


def trace_csv(missions: Sequence[MissionRun]) -> str:
    """Every visited state of every mission; see the module's text. Times to 1 ms, energies to 1 mJ."""
    return _table(
        TRACE_HEADER,
        (
            (
                mission.number,
                run.agent,
                record.step,
                _rounded(record.time_s),
                record.row,
                record.column,
                int(record.captured),
                record.action,
                _rounded(record.uav_energy_j),
            )
            for mission in missions
            for run in mission.agents
            for record in run.records
        ),
    )


def map_csv(mission: MissionRun) -> str:
    """Truth and prediction of every cell with data; see the module's text. Numbers read back exactly."""
    shape = map_shape(mission)
    if shape is None:
        return _table(MAP_HEADER, ())
    predicted = grid_or_nan(mission.artefacts.get(PREDICTED), shape)
    classes = grid_or_nan(mission.artefacts.get(CLASS), shape)
    truth = grid_or_nan(mission.environment.truth if mission.environment else None, shape)
    valid = mission.environment.grid.valid if mission.environment else np.isfinite(predicted)
    return _table(
        MAP_HEADER,
        (
            (
                row,
                column,
                _exact(truth[row, column]),
                _exact(predicted[row, column]),
                _exact(classes[row, column]),
                int(row * shape[1] + column in mission.visited),
            )
            for row, column in np.argwhere(valid).tolist()
        ),
    )


def map_shape(mission: MissionRun) -> tuple[int, int] | None:
    """Rows and columns of a mission's grid; None when neither context nor artefacts are there."""
    if mission.environment is not None:
        return mission.environment.grid.rows, mission.environment.grid.columns
    grid = mission.artefacts.get(PREDICTED)
    return (grid.shape[0], grid.shape[1]) if grid is not None and grid.ndim == 2 else None


def grid_or_nan(grid: NDArray[np.float64] | None, shape: tuple[int, int]) -> NDArray[np.float64]:
    """The grid; all NaN when there is none of this shape."""
    return grid if grid is not None and grid.shape == shape else np.full(shape, np.nan)


def _rounded(value: float) -> str:
    return _exact(round(value, 3))


def _exact(value: float) -> str:
    """Shortest text that reads back to the same number: 3, 0.25; empty for what is not known."""
    number = float(value)
    if not math.isfinite(number):
        return ""
    return str(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)


def _table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()

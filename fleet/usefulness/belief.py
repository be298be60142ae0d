"""What a mission's own records say of the whole field: the ground of replays.

States that were captured have their SSV. All others have the mean of the nearest captured ones, weighted by inverse
squared distance: no truth is used, and a field without structure is simply smooth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.grid import Grid
from fleet.errors import MissionError
from fleet.missions.records import Record

NEIGHBOURS = 8


def believed_ssv(grid: Grid, logs: Mapping[str, Sequence[Record]]) -> NDArray[np.float64]:
    """SSVs of all states with data, by what the agents of a mission have captured.

    Returns:
        float64 [cells, features]; NaN rows for cells without data.
    Raises:
        MissionError: nothing was captured.
    """
    captured = {record.cell: record.ssv for agent in sorted(logs) for record in logs[agent] if record.captured}
    if not captured:
        raise MissionError("the mission captured nothing, so nothing can be replayed")
    known = np.array(sorted(captured), dtype=np.int64)
    values = np.array([captured[int(cell)] for cell in known], dtype=np.float64)
    field = np.full((grid.cells, values.shape[1]), np.nan)
    unknown = np.setdiff1d(np.flatnonzero(grid.valid.ravel()), known)
    field[known] = values
    if len(unknown):
        field[unknown] = _inverse_distance(places(grid, known), values, places(grid, unknown))
    return field


def places(grid: Grid, cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """Where the middles of cells are, float64 [n, 2], in m."""
    rows, columns = np.divmod(cells, grid.columns)
    return np.stack([rows * grid.cell_height_m, columns * grid.cell_width_m], axis=1)


def _inverse_distance(
    at: NDArray[np.float64], values: NDArray[np.float64], wanted: NDArray[np.float64]
) -> NDArray[np.float64]:
    from scipy.spatial import KDTree  # noqa: PLC0415 - loads only in roles that weigh

    distances, nearest = KDTree(at).query(wanted, k=min(NEIGHBOURS, len(at)))
    distances, nearest = distances.reshape(len(wanted), -1), nearest.reshape(len(wanted), -1)
    weights = 1.0 / np.square(distances)  # never 0: what is wanted was not captured
    return np.asarray((values[nearest] * weights[..., None]).sum(axis=1) / weights.sum(axis=1)[:, None])

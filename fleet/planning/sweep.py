"""The first lines over a part of a field: they give a picture of all of it, before anything is worth looking at.

Without them an agent that flies where classes are in doubt may stay where it began, with a wrong idea of the field's
mean, which all classes refer to.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.grid import Grid

SPACING = 12
"""Rows or columns from one line to the next."""


def lines(grid: Grid, part: NDArray[np.int64], along_rows: bool, offset: float, spacing: int = SPACING) -> list[int]:
    """Where lines through a part begin and end, in the order of flight: back and forth.

    Args:
        part: Cells of the part, at least one.
        offset: Where the first line lies between the edge and the spacing, 0..1.

    Returns:
        Cells of the part; at least two.
    """
    rows, columns = np.divmod(part, grid.columns)
    across, along = (rows, columns) if along_rows else (columns, rows)
    places = np.unique(across)
    count = max(1, round(len(places) / spacing))
    stops: list[int] = []
    for line in range(count):
        place = places[int((line + offset) * len(places) / count)]
        found = along[across == place]
        ends = [int(found.min()), int(found.max())]
        ends = ends if line % 2 == 0 else ends[::-1]
        stops += [grid.cell(int(place), end) if along_rows else grid.cell(end, int(place)) for end in ends]
    return stops

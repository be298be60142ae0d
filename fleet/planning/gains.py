"""What captures brought: the belief before each of them, and how many cells became right on the map by it.

Whether a cell is right can be told for cells that are known in the end: all of a context, and those of a flown mission
that were captured sooner or later. What a capture did there stands for what it did to the others.

One capture's gain is nearly all noise, so what is far out counts as less far out, and a capture after which the
covariance was fitted anew does not count.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.grid import Grid
from fleet.functions.belief import Belief
from fleet.functions.classes import classes, likely_values
from fleet.planning.interest import FEW, features

Values = NDArray[np.float64]
MOST = 256
"""Captures that are looked at, evenly among all: each takes two looks at the whole field."""
FARTHEST = 5.0
"""Cells; what a capture brought counts for no more, one way or the other."""


def gains(belief: Belief, cells: Sequence[int], known: Values) -> tuple[Values, Values]:
    """Features of captured cells before their capture, and what the captures brought.

    Args:
        belief: What was believed before the first capture; it takes the captures in.
        cells: Captured cells, in the order of time.
        known: What is known of each cell in the end, float64 [cells], of the captured ones at least; NaN elsewhere.

    Returns:
        float64 [n, 3] as `fleet.planning.interest.features`, and float64 [n] in cells; n is at most MOST.
    """
    map_of = _Map(belief.grid, known)
    chosen = set(np.linspace(FEW, len(cells) - 1, MOST).round().astype(int).tolist()) if len(cells) > FEW else set()
    found, brought = [], []
    for index, cell in enumerate(cells):
        looked_at = index in chosen and belief.captured >= FEW and bool(belief.free.flat[cell])
        before, variogram = (map_of.right(belief, cell) if looked_at else 0.0), belief.variogram
        seen = features(belief).reshape(-1, belief.grid.cells)[:, cell] if looked_at else None
        belief.observe([cell], [known[cell]])
        if seen is not None and belief.variogram == variogram:
            found.append(seen)
            brought.append(np.clip(map_of.right(belief, cell) - before, -FARTHEST, FARTHEST))
    return np.array(found).reshape(-1, 3), np.array(brought, dtype=np.float64)


class _Map:
    """Holds the map of a belief against what is known in the end."""

    def __init__(self, grid: Grid, known: Values) -> None:
        self._known = np.isfinite(known)
        self._mean = float(known[self._known].mean())
        self._true = classes(known, self._mean)
        self._others = float(np.count_nonzero(grid.valid)) / float(np.count_nonzero(self._known))

    def right(self, belief: Belief, cell: int) -> float:
        """How many cells are right: the one that is captured, and of the others as many as those known stand for."""
        found = classes(likely_values(belief.prediction(), self._mean), self._mean).reshape(-1)
        right = (found == self._true) & self._known
        here = float(right[cell])
        return here + self._others * (float(np.count_nonzero(right)) - here)

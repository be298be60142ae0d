"""What an agent sees of the field when it decides: all that is within reach, samples of the rest, and rich places.

As `fleet.planning.interest`, but for parts of the field, so that a decision takes as long on a large field as on a
small one. Nothing is remembered from one decision to the next but what others claim: whoever has the same belief sees
the same, however often it has looked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fleet.functions.belief import Belief, class_bounds
from fleet.planning.interest import AROUND, FAR, FEW, REACH
from fleet.planning.outlook_kernel import SIDE, Sketch, Wishes, look, promising, richest
from fleet.planning.tactics import InterestWeights

Values = NDArray[np.float64]

WHOLE = 4096
"""A field of at most so many cells is seen whole."""
_SAMPLED, _BLOCK = 2304, 12
"""Of a larger one so many cells are sampled, in squares of so many rows and columns that are evenly spread."""
_LISTED = 16
"""Tiles that are looked into for the richest place."""
_NONE: NDArray[np.int64] = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class View:
    """What is within reach.

    Args:
        interest: What each capture adds, float64 [rows, columns]; 0 where nothing is to be had. Valid until the next
            look.
        cell: Number of the agent's own cell in that.
        typical: Mean interest of the better half of the cells of the field that have any, those that others are about
            to capture left out; 0 when there are none.
    """

    interest: Values
    cell: int
    typical: float


class Outlook:
    """Looks at what is believed of a field. Not for use by several threads at once.

    Args:
        belief: What is believed.
        horizon: Longest path that an agent looks for, in moves.
    """

    def __init__(self, belief: Belief, horizon: int) -> None:
        self._belief, self._horizon = belief, horizon
        rows, columns = belief.grid.rows, belief.grid.columns
        self._sketch = Sketch(
            doubt=np.zeros((rows + 2 * REACH, columns + 2 * REACH)),
            interest=np.zeros((rows + 2 * SIDE, columns + 2 * SIDE)),
            line=np.zeros(columns),
            claimed=np.zeros(belief.grid.cells, dtype=np.int32),
            listed=np.zeros(_LISTED, dtype=np.int64),
            score=np.zeros(_LISTED),
        )
        self._claims: dict[int, NDArray[np.int64]] = {}

    def claim(self, agent: int, cells: Sequence[int]) -> None:
        """An agent is about to capture these cells, until it claims others: they are of no interest.

        Args:
            agent: Its number.
            cells: Cell numbers.
        """
        np.subtract.at(self._sketch.claimed, self._claims.pop(agent, _NONE), 1)
        if len(cells):
            self._claims[agent] = np.asarray(cells, dtype=np.int64)
            np.add.at(self._sketch.claimed, self._claims[agent], 1)

    def view(self, cell: int, weights: InterestWeights) -> View:
        """Look around.

        Args:
            cell: Where the agent is.
            weights: What makes a capture interesting to it.
        """
        window = self._window(cell)
        found, wishes = self._room, self._wishes(weights)
        parts = np.vstack((self._sampled, window))
        count = look(self._belief.state, self._sketch, wishes, parts, found)
        top, bottom, left, right = (int(bound) for bound in window)
        row, column = self._belief.grid.position(cell)
        seen = self._sketch.interest[top + SIDE : bottom + SIDE, left + SIDE : right + SIDE]
        return View(seen, (row - top) * (right - left) + column - left, _mean_of_better_half(found[:count]))

    def richest(self, cell: int, weights: InterestWeights) -> int | None:
        """The cell around which there is most interest for the way there; None when nothing is of interest.

        On a field of more than 16 tiles only those are looked into that may be richest by a few of their cells; all of
        them when there is no interest in these.
        """
        state, wishes = self._belief.state, self._wishes(weights)
        start = self._belief.grid.position(cell)
        free = np.flatnonzero(state.left)
        tiles = free
        if len(free) > _LISTED:
            tiles = self._sketch.listed[: promising(state, self._sketch, wishes, start)]
        found = int(richest(state, self._sketch, wishes, start, tiles))
        if found < 0 and len(free) > _LISTED:
            found = int(richest(state, self._sketch, wishes, start, free))
        return found if found >= 0 else None

    def _wishes(self, weights: InterestWeights) -> Wishes:
        belief = self._belief
        fall = (belief.grid.cell_width_m / belief.grid.cell_height_m) ** 0.5 / FAR
        equal = belief.captured < FEW
        bounds = class_bounds(belief.class_mean)
        return Wishes(weights.doubt, weights.doubt_around, weights.novelty, equal, bounds, AROUND, fall)

    def _window(self, cell: int) -> NDArray[np.int64]:
        """First and last row and column that paths reach, the last ones excluded."""
        grid, far = self._belief.grid, self._horizon
        row, column = grid.position(cell)
        rows, columns = (max(row - far, 0), min(row + far + 1, grid.rows)), (max(column - far, 0), column + far + 1)
        return np.array([*rows, columns[0], min(columns[1], grid.columns)])

    @cached_property
    def _room(self) -> Values:
        return np.empty(WHOLE)

    @cached_property
    def _sampled(self) -> NDArray[np.int64]:
        """Parts of the field that stand for all of it, as `_window`, int64 [parts, 4]."""
        rows, columns = self._belief.grid.rows, self._belief.grid.columns
        if rows * columns <= WHOLE:
            return np.array([[0, rows, 0, columns]])
        blocks = _SAMPLED // (min(rows, _BLOCK) * min(columns, _BLOCK))
        down = int(np.clip(round((blocks * rows / columns) ** 0.5), 1, min(-(-rows // _BLOCK), blocks)))
        tops, bottoms = _spread(rows, down)
        lefts, rights = _spread(columns, min(blocks // down, -(-columns // _BLOCK)))
        parts = np.broadcast_arrays(tops[:, None], bottoms[:, None], lefts, rights)
        return np.stack([part.reshape(-1) for part in parts], axis=1)


def _spread(size: int, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Beginnings and ends of so many pieces of a side, evenly spread and apart."""
    middles = (np.arange(count) + 0.5) * (size / count)
    first = np.maximum(middles - _BLOCK / 2, 0.0).astype(np.int64)
    return first, np.minimum(first + _BLOCK, np.append(first[1:], size))


def _mean_of_better_half(values: Values) -> float:
    if not len(values):
        return 0.0
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle:].mean())

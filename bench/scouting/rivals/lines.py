"""Plans along whole lines: transects, evenly spaced with all on the way captured, and the lawnmower, which leaves none.

All lines are one path, back and forth, cut into pieces of equal energy for the agents: they finish at the same time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.scouting.fields import Field
from bench.scouting.flight import Flights
from bench.scouting.paths import serpentine, shared_out


@dataclass(frozen=True)
class Transects:
    """Evenly spaced rows or columns from a random first one; the budget is the share of lines."""

    along_rows: bool

    @property
    def name(self) -> str:
        """For tables."""
        return f"transects, {'rows' if self.along_rows else 'columns'}"

    def budgets(self, field: Field) -> Sequence[float]:
        """Every number of lines from one to all."""
        lines = self._lines(field)
        return tuple(np.arange(1, lines + 1) / lines)

    def fly(self, field: Field, agents: int, seed: int, budget: float | None) -> Flights:
        """Fly a share of the lines, all when there is no budget."""
        lines = self._lines(field)
        chosen = max(1, round((1.0 if budget is None else budget) * lines))
        first = np.random.default_rng(seed).random()
        path = serpentine(field.grid, _used(field, self.along_rows)[_evenly(lines, chosen, first)], self.along_rows)
        return shared_out(field.grid, path, agents)

    def _lines(self, field: Field) -> int:
        return len(_used(field, self.along_rows))


@dataclass(frozen=True)
class Lawnmower:
    """Row by row, without leaving one out: what the paper calls automated."""

    name: str = "lawnmower"

    def budgets(self, field: Field) -> Sequence[float]:
        """None: it flies on until it is stopped."""
        return ()

    def fly(self, field: Field, agents: int, seed: int, budget: float | None) -> Flights:
        """Fly all rows."""
        return shared_out(field.grid, serpentine(field.grid, range(field.grid.rows), along_rows=True), agents)


def _used(field: Field, along_rows: bool) -> NDArray[np.int64]:
    """Lines that have data."""
    return np.flatnonzero(field.grid.valid.any(axis=1 if along_rows else 0))


def _evenly(lines: int, chosen: int, first: float) -> NDArray[np.int64]:
    """Indices of evenly spaced lines; `first` in [0, 1) is where in the first gap they begin."""
    return np.floor((np.arange(chosen) + first) * lines / chosen).astype(np.int64)

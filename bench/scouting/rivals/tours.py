"""Plans of chosen cells with a good tour through them: random cells, or cells of a lattice that fills the plane evenly.

The chosen cells are divided into compact parts of equally many for the agents. Cells on the way are left alone, which
is best where captures count, or captured too, which is best where energy counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.scouting.fields import Field
from bench.scouting.flight import Flight, Flights, flown
from bench.scouting.paths import NONE, through
from bench.scouting.tour import tour
from fleet.contexts.grid import Grid
from fleet.missions.partition import parts

LADDER = tuple((np.arange(1, 51) / 50).tolist())
"""Budgets in steps of 2 % of the cells."""
_PLASTIC = 1.32471795724474602596
"""Root of x^3 = x + 1."""


@dataclass(frozen=True)
class RandomTour:
    """Random cells, and a tour."""

    whole_path: bool = False

    @property
    def name(self) -> str:
        """For tables."""
        return "random + tour" + _suffix(self.whole_path)

    def budgets(self, field: Field) -> Sequence[float]:
        """Steps of 2 % of the cells."""
        return LADDER

    def fly(self, field: Field, agents: int, seed: int, budget: float | None) -> Flights:
        """Fly to a share of the cells, to all when there is no budget."""
        order = np.random.default_rng(seed).permutation(field.cells)
        return visit(field, order[: _count(field, agents, budget)], agents, self.whole_path)


@dataclass(frozen=True)
class LatticeTour:
    """Cells of the R2 sequence, and a tour.

    Source: Roberts 2018, The unreasonable effectiveness of quasirandom sequences.
    """

    whole_path: bool = False

    @property
    def name(self) -> str:
        """For tables."""
        return "lattice + tour" + _suffix(self.whole_path)

    def budgets(self, field: Field) -> Sequence[float]:
        """Steps of 2 % of the cells."""
        return LADDER

    def fly(self, field: Field, agents: int, seed: int, budget: float | None) -> Flights:
        """Fly to a share of the cells, to all when there is no budget."""
        chosen = r2_cells(field.grid, _count(field, agents, budget), np.random.default_rng(seed).random(2))
        return visit(field, chosen, agents, self.whole_path)


def r2_cells(grid: Grid, count: int, first: NDArray[np.float64]) -> NDArray[np.int64]:
    """The first different cells with data that the R2 sequence comes to, int64 [count].

    Args:
        first: Where the sequence begins, in [0, 1), float64 [2].
    """
    steps = np.array([1 / _PLASTIC, 1 / _PLASTIC**2])
    tries = 4 * grid.cells
    while True:
        points = (first + np.arange(tries)[:, None] * steps) % 1.0
        cells = (points[:, 0] * grid.rows).astype(np.int64) * grid.columns + (points[:, 1] * grid.columns).astype(int)
        cells = cells[grid.valid.reshape(-1)[cells]]
        places = np.sort(np.unique(cells, return_index=True)[1])
        if len(places) >= count:
            return np.asarray(cells[places[:count]])
        tries *= 2


def visit(field: Field, chosen: NDArray[np.int64], agents: int, whole_path: bool) -> Flights:
    """Tours of all agents through chosen cells."""
    mask = np.zeros(field.grid.cells, dtype=np.bool_)
    mask[chosen] = True
    wanted = replace(field.grid, valid=mask.reshape(field.grid.rows, field.grid.columns))
    return tuple(_toured(field.grid, part, whole_path) for part in parts(wanted, agents))


def _toured(grid: Grid, stops: NDArray[np.int64], whole_path: bool) -> Flight:
    path = through(grid, tour(grid, stops)) if len(stops) else NONE
    if whole_path:
        return flown(grid, path)
    captured = np.zeros(len(path), dtype=np.bool_)
    first = np.unique(path, return_index=True)
    captured[first[1][np.isin(first[0], stops)]] = True
    return flown(grid, path, captured)


def _count(field: Field, agents: int, budget: float | None) -> int:
    return max(agents, round((1.0 if budget is None else budget) * len(field.cells)))


def _suffix(whole_path: bool) -> str:
    return ", whole path" if whole_path else ""

"""The best short path over the field: beam search over straight moves.

A path is worth what the first visits of its cells add, minus what its energy costs at the going rate. Nothing is
learned by coming back to a cell, so this is the orienteering problem; a beam of paths, the best of each length, finds
good ones. Source: Singh et al. 2009, Efficient Informative Sensing using Multiple Robots, JAIR 34 (the problem);
Lowerre 1976 (beam search).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.grid import Grid
from fleet.energy.accounting import EnergyModel
from fleet.missions.layout import MOVES
from fleet.planning.kernel import Beam, search
from fleet.planning.tactics import Search

Values = NDArray[np.float64]
STRAIGHT = 4
"""The first so many of MOVES are straight, and move 2n + 1 is the reverse of move 2n."""


@dataclass(frozen=True, eq=False)
class PathFinder:
    """Finds paths on one grid. Not for use by several threads at once: the room for paths is kept.

    Args:
        grid: Where paths lead.
        energy: What moves and captures cost.
        look: How far and how wide is looked.
    """

    grid: Grid
    energy: EnergyModel
    look: Search

    def best(self, interest: Values, cell: int, last: int, rate: float) -> tuple[int, ...]:
        """The moves, indices into MOVES, of the best path from a cell; none when none is worth its energy.

        Args:
            interest: What capturing each cell adds, float64 [rows, columns], at least 0; 0 where nothing is to be had.
            cell: Where the path begins.
            last: The move that led there; -1 for none. It is not undone at once.
            rate: Interest that a joule is worth.
        """
        worth = np.where(interest > 0.0, interest - rate * self._capture_j, 0.0)
        beam = self._beam
        length = int(search(beam, worth, self._steps, rate * self._costs_j, (cell, last)))
        moves, index = [], 0
        for depth in range(length, 0, -1):
            moves.append(int(beam.move[depth, index]))
            index = int(beam.parent[depth, index])
        return tuple(reversed(moves))

    def towards(self, cell: int, target: int) -> tuple[int, ...]:
        """The moves from a cell to another one, always along the longer way that is left."""
        (row, column), (last_row, last_column) = self.grid.position(cell), self.grid.position(target)
        down, across = last_row - row, last_column - column
        moves = []
        while down or across:
            step = (int(np.sign(down)), 0) if abs(down) >= abs(across) else (0, int(np.sign(across)))
            moves.append(self._of_step[step])
            down, across = down - step[0], across - step[1]
        return tuple(moves)

    @cached_property
    def mean_move_j(self) -> float:
        """Energy of a move, on average over the directions, in J."""
        return float(self._costs_j.mean())

    @cached_property
    def _capture_j(self) -> float:
        return self.energy.capture().energy_j

    @cached_property
    def _costs_j(self) -> Values:
        return np.array([self.energy.move(move).energy_j for move in MOVES[:STRAIGHT]])

    @cached_property
    def _steps(self) -> NDArray[np.int64]:
        return np.array([self.grid.step(move) for move in MOVES[:STRAIGHT]], dtype=np.int64)

    @cached_property
    def _of_step(self) -> dict[tuple[int, int], int]:
        return {(int(down), int(across)): move for move, (down, across) in enumerate(self._steps)}

    @cached_property
    def _beam(self) -> Beam:
        shape = (self.look.horizon + 1, self.look.width)
        cell, parent, move = (np.zeros(shape, dtype=np.int64) for _ in range(3))
        return Beam(cell, parent, move, np.zeros(shape))

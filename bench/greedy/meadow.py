"""Missions of agents that fly by what is believed of the cells beside them: belief features in the SSV, one step ahead.

The SSV of a state that a move leads to is what kriging says of its cell, and where unvisited cells lie (`FEATURES`). SA
is a weighted sum of these features; the best move wins. Without a free cell beside it an agent flies to the nearest
one. Agents move one after the other, and share what they have captured. The covariance of the field is given: over a
context whose truth is known it can be fitted beforehand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.greedy import kernel
from bench.greedy.kernel import Ground, Sky
from fleet.contexts.base import Environment
from fleet.contexts.grid import Grid
from fleet.energy.accounting import EnergyModel
from fleet.errors import ContextError
from fleet.functions import compiled_kriging
from fleet.functions.kriging import fit, places_of
from fleet.functions.local_kriging import NEIGHBOURS
from fleet.missions.layout import MOVES

FEATURES = ("doubt", "deviation", "open", "ahead", "cost")
"""Of the state that a move leads to: probability that its believed class is wrong; deviation as a share of the field's;
share of the cells beside it that are free; 1 when the move is the last one again; energy of the move as a share of the
mean of all moves. Classes refer to the mean of what is captured."""
STRAIGHT = kernel.MOVES


@dataclass(frozen=True, eq=False)
class Meadow:
    """A known field that missions fly over, again and again.

    Args:
        grid: Its cells.
        ground: The same for the kernel.
    """

    grid: Grid
    ground: Ground

    @staticmethod
    def of(environment: Environment, energy: EnergyModel) -> Meadow:
        """A context made ready.

        Raises:
            ContextError: the truth is not known there.
        """
        if environment.truth is None:
            raise ContextError(f"nothing is known of the truth in {environment.name}, so nothing can be flown there")
        grid, truth = environment.grid, environment.truth
        bordered = Grid(np.pad(grid.valid, 1), grid.cell_height_m, grid.cell_width_m)
        variogram = fit(np.where(grid.valid, truth, np.nan), grid.valid, grid)
        steps = compiled_kriging.steps_for(bordered)
        free = compiled_kriging.with_margin(bordered.valid, steps)
        number = np.pad(
            np.arange(bordered.cells, dtype=np.int32).reshape(bordered.valid.shape),
            [(margin, margin) for margin in steps.margin],
            constant_values=-1,
        )
        moves = [grid.step(move) for move in MOVES[:STRAIGHT]]
        costs = np.array([energy.move(move).energy_j for move in MOVES[:STRAIGHT]])
        ground = Ground(
            free=free.reshape(-1),
            number=number.reshape(-1),
            values=np.pad(np.nan_to_num(truth), 1).reshape(-1),
            size=int(np.count_nonzero(grid.valid)),
            places=places_of(bordered, variogram),
            variance=variogram.variance,
            steps=steps,
            ways=np.array([down * free.shape[1] + across for down, across in moves], dtype=np.int64),
            compass=np.array([moves.index(step) for step in ((1, 0), (-1, 0), (0, 1), (0, -1))], dtype=np.int64),
            costs=costs / costs.mean(),
        )
        return Meadow(grid, ground)

    def fly(self, starts: Sequence[int], weights: NDArray[np.float64], moves: int) -> NDArray[np.int32]:
        """Fly a mission with each row of weights.

        Args:
            starts: Cells with data where agents take off, [N].
            weights: Of the features, float64 [M, 5].
            moves: Of each agent, at most.

        Returns:
            Cells in the order of flight, int32 [M, N, moves + 1]; -1 after the last when all was captured before.
        """
        path = np.full((len(weights), len(starts), moves + 1), -1, dtype=np.int32)
        places = np.flatnonzero(self.ground.number >= 0)
        where = np.array([places[self._bordered(cell)] for cell in starts], dtype=np.int64)
        kernel.fly(self.ground, self._sky(len(starts)), where, weights, path)
        row, column = np.divmod(path, self.grid.columns + 2)
        return np.where(path < 0, -1, (row - 1) * self.grid.columns + column - 1).astype(np.int32)

    def _bordered(self, cell: int) -> int:
        row, column = self.grid.position(cell)
        return (row + 1) * (self.grid.columns + 2) + column + 1

    def _sky(self, agents: int) -> Sky:
        return Sky(
            free=np.zeros_like(self.ground.free),
            known=np.zeros_like(self.ground.free),
            at=np.zeros(agents, dtype=np.int64),
            last=np.zeros(agents, dtype=np.int64),
            target=np.zeros(agents, dtype=np.int64),
            near=np.zeros(NEIGHBOURS, dtype=np.int32),
            scratch=compiled_kriging.scratch_for(NEIGHBOURS),
            ssv=np.zeros(len(FEATURES)),
            bounds=np.zeros(3),
            total=np.zeros(1),
            captured=np.zeros(1, dtype=np.int64),
        )

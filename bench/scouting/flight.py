"""What a plan flies: cells in order, what was captured in them, and what it cost up to each of them.

A flight takes off in its first cell and lands in its last one. A cell costs the move into it and, when it is captured,
the capture; costs are those of `fleet.energy`, whose profile `spark-survey` gives a straight move 5 s and a capture
1 s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.scouting.fields import Field
from fleet.contexts.grid import Grid
from fleet.energy.accounting import EnergyModel
from fleet.energy.profiles import load_aircraft, load_edge
from fleet.spec.swarm import Action

ENERGY = EnergyModel(load_aircraft("spark-survey"), load_edge("laptop-i5"))
Cells = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Flight:
    """The flight of one agent.

    Args:
        cells: Visited cells in order, the take-off cell first, int64 [S]; each borders on the one before.
        captured: Which visits captured the cell, bool [S]; in a cell without data there is nothing to capture.
        energy_j: Energy spent up to and with each cell, take-off included and landing not, float64 [S].
        time_s: Time since the start of the mission likewise, float64 [S].
        landing_j, landing_s: Energy and time of the landing; 0 for a flight that never took off.
    """

    cells: Cells
    captured: Flags
    energy_j: NDArray[np.float64]
    time_s: NDArray[np.float64]
    landing_j: float
    landing_s: float

    @property
    def total_j(self) -> float:
        """Energy of the whole flight."""
        return float(self.energy_j[-1]) + self.landing_j if len(self.cells) else 0.0

    @property
    def total_s(self) -> float:
        """Time of the whole flight."""
        return float(self.time_s[-1]) + self.landing_s if len(self.cells) else 0.0


Flights = tuple[Flight, ...]
"""One flight for each agent."""


def flown(
    grid: Grid, cells: Cells, captured: Flags | None = None, waited_s: NDArray[np.float64] | None = None
) -> Flight:
    """A flight through cells.

    Args:
        cells: int64 [S]; moves are to one of the 8 neighbours. Without any the agent stays on the ground.
        captured: bool [S]; when left out, each cell is captured on the first visit.
        waited_s: How long the aircraft hovered in each cell, float64 [S]; nowhere when left out.
    Raises:
        ValueError: two successive cells are not neighbours, or a cell without data is captured.
    """
    cells = np.asarray(cells, dtype=np.int64)
    if not len(cells):
        none = np.zeros(0)
        return Flight(cells, np.zeros(0, dtype=np.bool_), none, none, 0.0, 0.0)
    taken = first_visits(grid, cells) if captured is None else np.asarray(captured, dtype=np.bool_)
    if (taken & ~grid.valid.reshape(-1)[cells]).any():
        raise ValueError("a cell without data was captured")
    step_j, step_s = _moves(grid, cells)
    capture, take_off, land = ENERGY.capture(), ENERGY.take_off(), ENERGY.land()
    wait_s = np.zeros(len(cells)) if waited_s is None else waited_s
    energy_j = take_off.energy_j + np.cumsum(step_j + taken * capture.energy_j + wait_s * ENERGY.aircraft.hover.power_w)
    time_s = take_off.time_s + np.cumsum(step_s + taken * capture.time_s + wait_s)
    return Flight(cells, taken, energy_j, time_s, land.energy_j, land.time_s)


def first_visits(grid: Grid, cells: Cells) -> Flags:
    """Which visits are the first one of a cell with data, bool [S]."""
    first = np.zeros(len(cells), dtype=np.bool_)
    first[np.unique(cells, return_index=True)[1]] = True
    return first & grid.valid.reshape(-1)[cells]


def thorough_j(field: Field, agents: int) -> float:
    """Energy of visiting and capturing every cell without a detour, one take-off and landing for each agent."""
    every = ENERGY.move(Action.EAST) + ENERGY.capture()
    return (every * len(field.cells) + (ENERGY.take_off() + ENERGY.land()) * agents).energy_j


def _moves(grid: Grid, cells: Cells) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Energy and time of the move into each cell, [S]; the first is where the agent took off."""
    rows, columns = np.divmod(cells, grid.columns)
    down, across = np.diff(rows), np.diff(columns)
    if len(down) and max(np.abs(down).max(), np.abs(across).max()) > 1:
        raise ValueError("two successive cells of a flight are not neighbours")
    energy_j, time_s = move_costs(grid)
    index = (down + 1, across + 1)
    return np.concatenate(([0.0], energy_j[index])), np.concatenate(([0.0], time_s[index]))


def move_costs(grid: Grid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Energy in J and time in s of a move by -1, 0 or 1 rows and columns, float64 [3, 3]; index by move + 1."""
    energy_j, time_s = np.zeros((3, 3)), np.zeros((3, 3))
    for action in Action:
        down, across = grid.step(action)
        cost = ENERGY.move(action)
        energy_j[down + 1, across + 1], time_s[down + 1, across + 1] = cost.energy_j, cost.time_s
    return energy_j, time_s

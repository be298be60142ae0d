"""A layout as flat arrays, built once for each layout, for the compiled kernel."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.grid import Grid
from fleet.missions.layout import MOVES, Layout


class LayoutArrays(NamedTuple):
    """The same as a `Layout`.

    Args:
        rows, columns: Size of the grid.
        group_of: Group of each cell, int32 [cells]; -1 without data.
        row, column: Of each cell, int32 [cells].
        members: Cells of all groups, one group after the other, int32 [cells with data].
        offsets: Where each group starts in `members`, int32 [groups + 1].
        first, last, starts: Part and take-off cell of each agent, int32 [N].
        set_of: Index of each agent's set of actions, int32 [N].
        inside: For each set of actions and each cell, the moves that stay in the cell's group as bits,
            uint8 [sets, cells].
        deltas: What each move adds to a cell's number, int64 [8].
        compass: Moves that lead one row down, one row up, one column on, one column back, int64 [4].
        width: One more than the highest move that any agent has: moves from there on need no look.
        capture_in_transit: Whether cells on the way to the next group are captured.
    """

    rows: int
    columns: int
    group_of: NDArray[np.int32]
    row: NDArray[np.int32]
    column: NDArray[np.int32]
    members: NDArray[np.int32]
    offsets: NDArray[np.int32]
    first: NDArray[np.int32]
    last: NDArray[np.int32]
    starts: NDArray[np.int32]
    set_of: NDArray[np.int32]
    inside: NDArray[np.uint8]
    deltas: NDArray[np.int64]
    compass: NDArray[np.int64]
    width: int
    capture_in_transit: bool


_BUILT: WeakKeyDictionary[Layout, LayoutArrays] = WeakKeyDictionary()


def arrays_of(layout: Layout) -> LayoutArrays:
    """The arrays of a layout; built when first asked for."""
    found = _BUILT.get(layout)
    if found is None:
        found = _BUILT[layout] = _build(layout)
    return found


def _build(layout: Layout) -> LayoutArrays:
    grid = layout.grid
    cells = np.arange(grid.cells, dtype=np.int32)
    sets = sorted(set(layout.actions))
    steps = [grid.step(action) for action in MOVES]
    return LayoutArrays(
        rows=grid.rows,
        columns=grid.columns,
        group_of=layout.group_of.astype(np.int32),
        row=cells // np.int32(grid.columns),
        column=cells % np.int32(grid.columns),
        members=np.concatenate(layout.groups).astype(np.int32),
        offsets=np.cumsum([0, *(len(group) for group in layout.groups)], dtype=np.int32),
        first=np.array([first for first, _ in layout.parts], dtype=np.int32),
        last=np.array([last for _, last in layout.parts], dtype=np.int32),
        starts=np.array(layout.starts, dtype=np.int32),
        set_of=np.array([sets.index(actions) for actions in layout.actions], dtype=np.int32),
        inside=np.stack([_inside(grid, layout.group_of, actions) for actions in sets]),
        deltas=np.array([rows * grid.columns + columns for rows, columns in steps], dtype=np.int64),
        compass=np.array([steps.index(step) for step in ((1, 0), (-1, 0), (0, 1), (0, -1))], dtype=np.int64),
        width=max(max(actions, default=0) for actions in sets) + 1,
        capture_in_transit=layout.capture_in_transit,
    )


def _inside(grid: Grid, group_of: NDArray[np.int64], actions: tuple[int, ...]) -> NDArray[np.uint8]:
    """Moves of a set of actions that stay in the group of the cell, as bits, uint8 [cells]."""
    here = group_of.reshape(grid.rows, grid.columns)
    padded = np.pad(here, 1, constant_values=-1)
    bits = np.zeros(here.shape, dtype=np.uint8)
    for move in actions:
        rows, columns = grid.step(MOVES[move])
        there = padded[1 + rows : 1 + rows + grid.rows, 1 + columns : 1 + columns + grid.columns]
        bits |= ((there == here) & (here >= 0)).astype(np.uint8) << np.uint8(move)
    return bits.ravel()


class BatchArrays(NamedTuple):
    """The same as a `Batch`, with orders of preference for scores: uint32 [P, cells], three bits a move."""

    orders: NDArray[np.uint32]
    table: NDArray[np.int64]
    rewards: NDArray[np.float64]
    reward_of: NDArray[np.int64]
    utility_thresholds: NDArray[np.float64]
    visited_thresholds: NDArray[np.int64]
    exploration: NDArray[np.float64]
    missions: NDArray[np.int64]
    seed: np.uint64


class FlownArrays(NamedTuple):
    """The arrays of `Flown`."""

    captured: NDArray[np.bool_]
    moves: NDArray[np.int64]
    captures: NDArray[np.int64]
    decisions: NDArray[np.int64]
    steps: NDArray[np.int64]
    groups_explored: NDArray[np.int64]


class TraceArrays(NamedTuple):
    """The arrays of `Trace`."""

    cell: NDArray[np.int32]
    captured: NDArray[np.bool_]
    legal: NDArray[np.uint8]
    move: NDArray[np.int8]

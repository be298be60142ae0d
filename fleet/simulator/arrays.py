"""Layouts, batches and results as flat arrays, for the compiled kernel.

The cells of a group lie in words of 64 bits, one word for each row of the group, so that a few operations on words
find the legal moves and the nearest cell that is left. Hence a group has at most 64 columns, as in the FleetSpec.
"""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.grid import Grid
from fleet.errors import MissionError
from fleet.missions.layout import MOVES, Layout

WORD_BITS = 64
STRAIGHT_MOVES = 4
"""The first so many of MOVES change the row or the column, never both."""


class LayoutArrays(NamedTuple):
    """The same as a `Layout`.

    Args:
        columns: Columns of the grid.
        row, column: Of each cell, int32 [cells].
        group_of: Group of each cell, int32 [cells]; -1 without data.
        word, bit: Where each cell is in `full`, int32 and uint8 [cells]; in word 0 without data.
        members: Cells with data, int32.
        sizes: Cells of each group, int32 [groups].
        top, left: First row and column of each group, int32 [groups].
        words: First word of each group, int32 [groups + 1]; word 0 and the last word are empty.
        full: Bits of all cells with data, uint64 [words].
        first, last, starts: Part and take-off cell of each agent, int32 [N].
        set_of: Index of each agent's set of actions, int32 [N].
        inside: For each set of actions and each cell, the moves that stay in the cell's group as bits,
            uint8 [sets, cells].
        moves: See `scored_moves`; the kernel is compiled for their number.
        cell_steps, row_steps, column_steps: What each move adds to cell, row and column, int64 [8].
        compass: Moves that lead one row down, one row up, one column on, one column back, int64 [4].
        capture_in_transit: Whether cells on the way to the next group are captured.
    """

    columns: int
    row: NDArray[np.int32]
    column: NDArray[np.int32]
    group_of: NDArray[np.int32]
    word: NDArray[np.int32]
    bit: NDArray[np.uint8]
    members: NDArray[np.int32]
    sizes: NDArray[np.int32]
    top: NDArray[np.int32]
    left: NDArray[np.int32]
    words: NDArray[np.int32]
    full: NDArray[np.uint64]
    first: NDArray[np.int32]
    last: NDArray[np.int32]
    starts: NDArray[np.int32]
    set_of: NDArray[np.int32]
    inside: NDArray[np.uint8]
    moves: tuple[int, ...]
    cell_steps: NDArray[np.int64]
    row_steps: NDArray[np.int64]
    column_steps: NDArray[np.int64]
    compass: NDArray[np.int64]
    capture_in_transit: bool


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
    land_at: NDArray[np.int64]


class FlownArrays(NamedTuple):
    """The arrays of `Flown`."""

    captured: NDArray[np.bool_]
    moves: NDArray[np.int64]
    captures: NDArray[np.int64]
    decisions: NDArray[np.int64]
    steps: NDArray[np.int64]
    groups_explored: NDArray[np.int64]


class TraceArrays(NamedTuple):
    """The arrays of `Trace`, and the steps in which groups were left, int64 [M, N, groups]; what finds no room is not
    written."""

    cell: NDArray[np.int32]
    captured: NDArray[np.bool_]
    legal: NDArray[np.uint8]
    move: NDArray[np.int8]
    left: NDArray[np.int64]


_BUILT: WeakKeyDictionary[Layout, LayoutArrays] = WeakKeyDictionary()


def arrays_of(layout: Layout) -> LayoutArrays:
    """The arrays of a layout; built when first asked for.

    Raises:
        MissionError: a group has more than 64 columns.
    """
    found = _BUILT.get(layout)
    if found is None:
        found = _BUILT[layout] = _build(layout)
    return found


def scored_moves(layout: Layout) -> tuple[int, ...]:
    """The moves whose scores count: the straight ones, or all when any agent has another."""
    straight = all(move < STRAIGHT_MOVES for actions in layout.actions for move in actions)
    return tuple(range(STRAIGHT_MOVES if straight else len(MOVES)))


class _Words(NamedTuple):
    members: NDArray[np.int64]
    sizes: NDArray[np.int64]
    top: NDArray[np.int64]
    left: NDArray[np.int64]
    words: NDArray[np.int64]
    word: NDArray[np.int64]
    bit: NDArray[np.int64]
    full: NDArray[np.uint64]


def _words(layout: Layout) -> _Words:
    """Lay the cells of each group out in words; see LayoutArrays."""
    members = np.concatenate(layout.groups)
    sizes = np.array([len(group) for group in layout.groups])
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    row, column = members // layout.grid.columns, members % layout.grid.columns
    top, bottom = np.minimum.reduceat(row, starts), np.maximum.reduceat(row, starts)
    left, right = np.minimum.reduceat(column, starts), np.maximum.reduceat(column, starts)
    if (right - left).max() >= WORD_BITS:
        raise MissionError(f"the simulator flies over groups of at most {WORD_BITS} columns")
    words = 1 + np.concatenate([[0], np.cumsum(bottom - top + 1)])
    group = np.repeat(np.arange(len(sizes)), sizes)
    word, bit = np.zeros(layout.grid.cells, dtype=np.int64), np.zeros(layout.grid.cells, dtype=np.int64)
    word[members] = words[group] + row - top[group]
    bit[members] = column - left[group]
    full = np.zeros(words[-1] + 1, dtype=np.uint64)
    np.bitwise_or.at(full, word[members], np.uint64(1) << bit[members].astype(np.uint64))
    return _Words(members, sizes, top, left, words, word, bit, full)


def _build(layout: Layout) -> LayoutArrays:
    grid, words = layout.grid, _words(layout)
    cells = np.arange(grid.cells)
    sets = sorted(set(layout.actions))
    steps = [grid.step(action) for action in MOVES]
    return LayoutArrays(
        columns=grid.columns,
        row=_int32(cells // grid.columns),
        column=_int32(cells % grid.columns),
        group_of=_int32(layout.group_of),
        word=_int32(words.word),
        bit=words.bit.astype(np.uint8),
        members=_int32(words.members),
        sizes=_int32(words.sizes),
        top=_int32(words.top),
        left=_int32(words.left),
        words=_int32(words.words),
        full=words.full,
        first=_int32([first for first, _ in layout.parts]),
        last=_int32([last for _, last in layout.parts]),
        starts=_int32(layout.starts),
        set_of=_int32([sets.index(actions) for actions in layout.actions]),
        inside=np.stack([_inside(grid, layout.group_of, actions) for actions in sets]),
        moves=scored_moves(layout),
        cell_steps=np.array([rows * grid.columns + columns for rows, columns in steps], dtype=np.int64),
        row_steps=np.array([rows for rows, _ in steps], dtype=np.int64),
        column_steps=np.array([columns for _, columns in steps], dtype=np.int64),
        compass=np.array([steps.index(step) for step in ((1, 0), (-1, 0), (0, 1), (0, -1))], dtype=np.int64),
        capture_in_transit=layout.capture_in_transit,
    )


def _int32(values: NDArray[np.int64] | list[int] | tuple[int, ...]) -> NDArray[np.int32]:
    return np.ascontiguousarray(values, dtype=np.int32)


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

"""The compiled form of the simulator; the only module that imports numba.

What makes it fast: a flight runs alone to its end, so its state stays in registers and the nearest cache; within a
group SA's loop needs no question but the group's own (every move leads to a state that is captured); each row of
scores is turned once into an order of preference, four bytes a cell, so that a choice is a few tests of bits without
branches; what a flight has touched is cleared along its path.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from fleet.randomness import GOLDEN_GAMMA, MIX_1, MIX_2
from fleet.simulator.arrays import BatchArrays, FlownArrays, LayoutArrays, TraceArrays

_F = TypeVar("_F", bound=Callable[..., Any])
_GAMMA, _MIX_1, _MIX_2 = np.uint64(GOLDEN_GAMMA), np.uint64(MIX_1), np.uint64(MIX_2)
_EXPLORE, _PICK = np.uint64(0), np.uint64(1)
_FAR = np.int64(2**62)
_SCAN_UP_TO = 16
"""Cells of a group that is searched cell by cell at once."""


def _program(function: _F) -> _F:
    """Compile an entry of the kernel.

    Arrays belong to the caller, so nothing here counts references to them (`_nrt`): a count is an atomic operation and
    costs more than a step.
    """
    options = {"nogil": True, "_nrt": False}
    try:
        return cast(_F, numba.njit(cache=True, **options)(function))
    except RuntimeError:  # neither the package's folder nor the user's cache can be written: each process compiles
        return cast(_F, numba.njit(**options)(function))


def _part(function: _F) -> _F:
    """Make a function a part of the programs that call it: a real call would pass a flight's state through memory."""
    return cast(_F, numba.njit(inline="always")(function))


class Scratch(NamedTuple):
    """What one flight remembers; clear between flights.

    Args:
        todo: 1 in cells with data that are not captured, uint8 [cells].
        visited: V of each group, int64 [groups].
        utility: U of each group, float64 [groups].
        path: Captured cells in order, int32 [cells].
    """

    todo: NDArray[np.uint8]
    visited: NDArray[np.int64]
    utility: NDArray[np.float64]
    path: NDArray[np.int32]


class _State(NamedTuple):
    """Where a flight is; `target` is -1 when the agent is not travelling."""

    cell: int
    step: int
    captures: int
    decisions: int
    target: int


class _Flight(NamedTuple):
    """What is fixed during one flight."""

    mission: int
    agent: int
    t_u: float
    t_v: int
    exploration: float
    stream: np.uint64
    land_at: int
    inside: NDArray[np.uint8]
    order: NDArray[np.uint32]
    rewards: NDArray[np.float64]
    moves: NDArray[np.int64]


@_part
def _mix(value: Any) -> Any:
    value = (value ^ (value >> np.uint64(30))) * _MIX_1
    value = (value ^ (value >> np.uint64(27))) * _MIX_2
    return value ^ (value >> np.uint64(31))


@_part
def _absorb(state: Any, counter: Any) -> Any:
    return _mix((state ^ np.uint64(counter)) + _GAMMA)


@_program
def rank(scores: Any, members: Any, width: Any, orders: Any) -> Any:
    """Write each cell's moves from best to worst, three bits each, the first of equals first.

    Args:
        scores: float64 [P, cells, 8].
        members: Cells with data.
        width: How many moves count.
        orders: Result, uint32 [P, cells].

    Returns:
        Index of the first table with a NaN; -1 when there is none.
    """
    for table in range(len(scores)):
        for member in members:
            row = scores[table, member]
            order = np.uint32(0)
            for move in range(width):
                score = row[move]
                if score != score:
                    return table
                place = 0
                for other in range(width):
                    place += (row[other] > score) | ((row[other] == score) & (other < move))
                order |= np.uint32(move) << np.uint32(3 * place)
            orders[table, member] = order
    return -1


@_part
def _scan(layout: Any, todo: Any, cell: Any, group: Any) -> Any:
    row, column = np.int64(layout.row[cell]), np.int64(layout.column[cell])
    least = _FAR
    for index in range(layout.offsets[group], layout.offsets[group + 1]):
        other = np.int64(layout.members[index])
        distance = abs(layout.row[other] - row) + abs(layout.column[other] - column)
        least = min(least, (distance << 32) + other if todo[other] else _FAR)
    return least & 0xFFFFFFFF


@_part
def _open(layout: Any, todo: Any, row: Any, column: Any, group: Any) -> Any:
    if row < 0 or column < 0 or row >= layout.rows or column >= layout.columns:
        return False
    cell = row * layout.columns + column
    return todo[cell] != 0 and layout.group_of[cell] == group


@_program
def _nearest(layout: Any, todo: Any, cell: Any, group: Any) -> Any:
    """The nearest cell of the group that is left, the first of equals.

    Looks around the cell in growing circles for as long as that can be cheaper than a look at the whole group.
    """
    row, column = np.int64(layout.row[cell]), np.int64(layout.column[cell])
    size = layout.offsets[group + 1] - layout.offsets[group]
    radius = 1 if size > _SCAN_UP_TO else size
    while 2 * radius * radius < size:
        for rows in range(-radius, radius + 1):
            columns = radius - abs(rows)
            if _open(layout, todo, row + rows, column - columns, group):
                return (row + rows) * layout.columns + column - columns
            if _open(layout, todo, row + rows, column + columns, group):
                return (row + rows) * layout.columns + column + columns
        radius += 1
    return _scan(layout, todo, cell, group)


@_part
def _flight_to(layout: Any, flight: Any, scratch: Any, state: Any, trace: Any) -> Any:
    """Travel to the target."""
    todo, visited, utility, path = scratch
    cell, step, captures, decisions, target = state
    rows = np.int64(layout.row[target]) - layout.row[cell]
    columns = np.int64(layout.column[target]) - layout.column[cell]
    down, across = layout.compass[0 if rows > 0 else 1], layout.compass[2 if columns > 0 else 3]
    rows, columns = abs(rows), abs(columns)
    while cell != target:
        vertical = rows >= columns
        move = down if vertical else across
        rows -= vertical
        columns -= not vertical
        if trace is not None:
            trace.move[flight.mission, flight.agent, step] = move
        flight.moves[move] += 1
        step += 1
        cell += layout.deltas[move]
        captured = todo[cell] != 0 and (layout.capture_in_transit or cell == target)
        if captured:
            group = layout.group_of[cell]
            todo[cell] = 0
            visited[group] += 1
            utility[group] += flight.rewards[cell]
            path[captures] = cell
            captures += 1
        if trace is not None:
            trace.cell[flight.mission, flight.agent, step] = cell
            trace.captured[flight.mission, flight.agent, step] = captured
    return _State(cell, step, captures, decisions, np.int64(-1))


@_part
def _explore(flight: Any, step: Any, legal: Any, best: Any) -> Any:
    here = _absorb(flight.stream, step)
    bits = _mix(_absorb(here, _EXPLORE) + _GAMMA)
    if np.float64(bits >> np.uint64(11)) * 2.0**-53 < flight.exploration:
        count = 0
        for move in range(8):
            count += (legal >> move) & 1
        pick = np.int64(_mix(_absorb(here, _PICK) + _GAMMA) % np.uint64(count))
        best = np.int64(-1)
        while pick >= 0:
            best += 1
            pick -= (legal >> best) & 1
    return best


@_part
def _roam(layout: Any, flight: Any, scratch: Any, state: Any, group: Any, trace: Any) -> Any:
    """Let SA move within the group until it is done, or no move is legal; True when it is done."""
    todo, visited, utility, path = scratch
    cell, step, captures, decisions, target = state
    inside, order, rewards, moves, deltas = flight.inside, flight.order, flight.rewards, flight.moves, layout.deltas
    size = np.int64(layout.offsets[group + 1] - layout.offsets[group])
    limit = flight.t_v + 1 if flight.t_v < size else size
    v, u = visited[group], utility[group]
    done = False
    while not done:
        ways = np.int64(inside[cell])
        preference = np.int64(order[cell])
        legal = np.int64(0)
        for move in range(layout.width):
            way = (ways >> move) & 1
            legal |= (way & todo[cell + (deltas[move] & -way)]) << move
        if legal == 0:
            break
        best = np.int64(0)
        for place in range(layout.width - 1, -1, -1):
            move = (preference >> (3 * place)) & 7
            best = move if (legal >> move) & 1 else best
        if flight.exploration > 0:
            best = _explore(flight, step, legal, best)
        if trace is not None:
            trace.legal[flight.mission, flight.agent, step] = legal
            trace.move[flight.mission, flight.agent, step] = best
        moves[best] += 1
        decisions += 1
        step += 1
        cell += deltas[best]
        todo[cell] = 0
        path[captures] = cell
        captures += 1
        v += 1
        u += rewards[cell]
        if trace is not None:
            trace.cell[flight.mission, flight.agent, step] = cell
            trace.captured[flight.mission, flight.agent, step] = True
        done = v >= limit or u > flight.t_u
    visited[group] = v
    utility[group] = u
    return _State(cell, step, captures, decisions, target), done


@_part
def _take_off(layout: Any, flight: Any, scratch: Any, trace: Any) -> Any:
    cell = np.int64(layout.starts[flight.agent])
    group = layout.first[flight.agent]
    target, captures = np.int64(-1), np.int64(0)
    if layout.group_of[cell] != group:
        target = _nearest(layout, scratch.todo, cell, group)
    captured = scratch.todo[cell] != 0 and (layout.capture_in_transit or target < 0)
    if captured:
        scratch.todo[cell] = 0
        scratch.visited[layout.group_of[cell]] += 1
        scratch.path[0] = cell
        captures += 1
    if trace is not None:
        trace.cell[flight.mission, flight.agent, 0] = cell
        trace.captured[flight.mission, flight.agent, 0] = captured
    return _State(cell, np.int64(0), captures, np.int64(0), target)


@_part
def _done(layout: Any, flight: Any, scratch: Any, group: Any) -> Any:
    visited = scratch.visited[group]
    exhausted = visited == layout.offsets[group + 1] - layout.offsets[group]
    return exhausted or scratch.utility[group] > flight.t_u or visited > flight.t_v


@_part
def _fly_one(layout: Any, flight: Any, scratch: Any, trace: Any, left: Any) -> Any:
    """One flight from take-off to landing: its last state and the number of groups that are behind it."""
    state = _take_off(layout, flight, scratch, trace)
    first, last = np.int64(layout.first[flight.agent]), np.int64(layout.last[flight.agent])
    group, leavings = first, 0
    while True:
        if state.target >= 0:
            state = _flight_to(layout, flight, scratch, state, trace)
        before = group
        while group < last and _done(layout, flight, scratch, group):
            group += 1
        if group == last:
            break
        if group != before:
            if left is not None:
                left[flight.mission, flight.agent, leavings] = state.step
                leavings += 1
            if state.step == flight.land_at:
                break
        if layout.group_of[state.cell] == group:
            state, done = _roam(layout, flight, scratch, state, group, trace)
            if done:
                continue
        target = _nearest(layout, scratch.todo, state.cell, group)
        state = _State(state.cell, state.step, state.captures, state.decisions, target)
    return state, group - first


@_program
def fly(layout: Any, batch: Any, flown: Any, scratch: Any, land_at: Any, trace: Any, left: Any) -> None:
    """Fly all missions; see `fleet.simulator.batch.fly`."""
    for mission in range(len(batch.missions)):
        for agent in range(len(layout.starts)):
            flight = _Flight(
                mission,
                agent,
                batch.utility_thresholds[mission],
                batch.visited_thresholds[mission],
                batch.exploration[mission],
                _absorb(_absorb(batch.seed, batch.missions[mission]), agent),
                land_at[mission, agent],
                layout.inside[layout.set_of[agent]],
                batch.orders[batch.table[mission, agent]],
                batch.rewards[batch.reward_of[mission]],
                flown.moves[mission, agent],
            )
            state, explored = _fly_one(layout, flight, scratch, trace, left)
            flown.steps[mission, agent] = state.step + 1
            flown.captures[mission, agent] = state.captures
            flown.decisions[mission, agent] = state.decisions
            flown.groups_explored[mission, agent] = explored
            for index in range(state.captures):
                cell = scratch.path[index]
                flown.captured[mission, cell] = True
                scratch.todo[cell] = 1
                scratch.visited[layout.group_of[cell]] = 0
                scratch.utility[layout.group_of[cell]] = 0.0

"""The compiled form of the simulator; the only module that imports numba."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from fleet.missions.layout import Layout
from fleet.randomness import GOLDEN_GAMMA, MIX_1, MIX_2
from fleet.simulator.arrays import LayoutArrays, arrays_of
from fleet.simulator.batch import Batch, Finished, Flown, Trace

_F = TypeVar("_F", bound=Callable[..., Any])
_GAMMA, _MIX_1, _MIX_2 = np.uint64(GOLDEN_GAMMA), np.uint64(MIX_1), np.uint64(MIX_2)
_EXPLORE, _PICK = np.uint64(0), np.uint64(1)
_NEVER = np.iinfo(np.int64).max


def _compiled(function: _F) -> _F:
    return cast(_F, numba.njit(cache=True, nogil=True)(function))


class _Trace(NamedTuple):
    cell: NDArray[np.int32]
    captured: NDArray[np.bool_]
    legal: NDArray[np.uint8]
    move: NDArray[np.int8]


class _Scratch(NamedTuple):
    todo: NDArray[np.uint8]
    visited: NDArray[np.int64]
    utility: NDArray[np.float64]
    path: NDArray[np.int32]


@_compiled
def _mix(value):
    value = (value ^ (value >> np.uint64(30))) * _MIX_1
    value = (value ^ (value >> np.uint64(27))) * _MIX_2
    return value ^ (value >> np.uint64(31))


@_compiled
def _absorb(state, counter):
    return _mix((state ^ np.uint64(counter)) + _GAMMA)


@_compiled
def _nearest(layout, todo, cell, group):
    row, column = layout.row[cell], layout.column[cell]
    best, least = -1, _NEVER
    for index in range(layout.offsets[group], layout.offsets[group + 1]):
        other = layout.members[index]
        if todo[other]:
            distance = abs(layout.row[other] - row) + abs(layout.column[other] - column)
            if distance < least:
                best, least = other, distance
    return best


@_compiled
def _flight(layout, batch, agent, mission, scores, rewards, land_at, flown_moves, scratch, trace, left):
    todo, visited, utility, path = scratch
    group_of, offsets, deltas = layout.group_of, layout.offsets, layout.deltas
    inside = layout.inside[layout.set_of[agent]]
    t_u, t_v, exploration = batch.utility_thresholds[mission], batch.visited_thresholds[mission], batch.exploration[mission]
    stream = _absorb(_absorb(np.uint64(batch.seed), batch.missions[mission]), agent)
    cell, step, captures, decisions, lefts = layout.starts[agent] + 0, 0, 0, 0, 0
    group = layout.first[agent] + 0
    last = layout.last[agent]
    target = -1
    if group_of[cell] != group:
        target = _nearest(layout, todo, cell, group)
    captured = todo[cell] and (layout.capture_in_transit or target < 0)
    if captured:
        todo[cell] = 0
        visited[group_of[cell]] += 1
        path[captures] = cell
        captures += 1
    if trace is not None:
        trace.cell[mission, agent, 0] = cell
        trace.captured[mission, agent, 0] = captured
    while True:
        if target >= 0:
            rows, columns = layout.row[target] - layout.row[cell], layout.column[target] - layout.column[cell]
            while cell != target:
                if abs(rows) >= abs(columns):
                    move = layout.compass[0] if rows > 0 else layout.compass[1]
                    rows -= 1 if rows > 0 else -1
                else:
                    move = layout.compass[2] if columns > 0 else layout.compass[3]
                    columns -= 1 if columns > 0 else -1
                if trace is not None:
                    trace.move[mission, agent, step] = move
                flown_moves[move] += 1
                step += 1
                cell += deltas[move]
                captured = todo[cell] and (layout.capture_in_transit or cell == target)
                if captured:
                    todo[cell] = 0
                    visited[group_of[cell]] += 1
                    utility[group_of[cell]] += rewards[cell]
                    path[captures] = cell
                    captures += 1
                if trace is not None:
                    trace.cell[mission, agent, step] = cell
                    trace.captured[mission, agent, step] = captured
            target = -1
        before = group
        while group < last and (
            visited[group] == offsets[group + 1] - offsets[group] or utility[group] > t_u or visited[group] > t_v
        ):
            group += 1
        if group == last:
            break
        if group != before:
            if left is not None:
                left[mission, agent, lefts] = step
                lefts += 1
            if step == land_at:
                break
        if group_of[cell] == group:
            size = offsets[group + 1] - offsets[group]
            limit = min(size, t_v + 1) if t_v < size else size
            v, u = visited[group], utility[group]
            done = False
            while True:
                count = 0
                legal = 0
                best = -1
                score = 0.0
                ways = inside[cell]
                for move in range(layout.highest_move):
                    bit = (ways >> move) & 1
                    free = bit & todo[cell + (deltas[move] & -bit)]
                    legal |= free << move
                    candidate = scores[cell, move]
                    better = (free != 0) & ((best < 0) | (candidate > score))
                    best = move if better else best
                    score = candidate if better else score
                if legal == 0:
                    break
                if exploration > 0:
                    here = _absorb(stream, step)
                    bits = _mix(_absorb(here, _EXPLORE) + _GAMMA)
                    if np.float64(bits >> np.uint64(11)) * 2.0**-53 < exploration:
                        for move in range(layout.highest_move):
                            count += (legal >> move) & 1
                        pick = np.int64(_mix(_absorb(here, _PICK) + _GAMMA) % np.uint64(count))
                        best = -1
                        while pick >= 0:
                            best += 1
                            pick -= (legal >> best) & 1
                if trace is not None:
                    trace.legal[mission, agent, step] = legal
                    trace.move[mission, agent, step] = best
                decisions += 1
                flown_moves[best] += 1
                step += 1
                cell += deltas[best]
                todo[cell] = 0
                path[captures] = cell
                captures += 1
                v += 1
                u += rewards[cell]
                if trace is not None:
                    trace.cell[mission, agent, step] = cell
                    trace.captured[mission, agent, step] = True
                if v >= limit or u > t_u:
                    done = True
                    break
            visited[group] = v
            utility[group] = u
            if done:
                continue
        target = _nearest(layout, todo, cell, group)
    return step + 1, captures, decisions, group - layout.first[agent]


@_compiled
def _fly(layout, batch, flown, scratch, land_at, trace, left):
    for mission in range(len(batch.missions)):
        rewards = batch.rewards[batch.reward_of[mission]]
        for agent in range(len(layout.starts)):
            steps, captures, decisions, explored = _flight(
                layout, batch, agent, mission, batch.scores[batch.table[mission, agent]], rewards, land_at[mission, agent],
                flown.moves[mission, agent], scratch, trace, left
            )
            flown.steps[mission, agent] = steps
            flown.captures[mission, agent] = captures
            flown.decisions[mission, agent] = decisions
            flown.groups_explored[mission, agent] = explored
            for index in range(captures):
                cell = scratch.path[index]
                flown.captured[mission, cell] = True
                scratch.todo[cell] = 1
                scratch.visited[layout.group_of[cell]] = 0
                scratch.utility[layout.group_of[cell]] = 0.0


class _Flown(NamedTuple):
    captured: NDArray[np.bool_]
    moves: NDArray[np.int64]
    captures: NDArray[np.int64]
    decisions: NDArray[np.int64]
    steps: NDArray[np.int64]
    groups_explored: NDArray[np.int64]


class _Batch(NamedTuple):
    scores: NDArray[np.float64]
    table: NDArray[np.int64]
    rewards: NDArray[np.float64]
    reward_of: NDArray[np.int64]
    utility_thresholds: NDArray[np.float64]
    visited_thresholds: NDArray[np.int64]
    exploration: NDArray[np.float64]
    missions: NDArray[np.int64]
    seed: np.uint64


def fly(layout: Layout, batch: Batch, traced: bool = False, finished: Finished | None = None) -> Flown:
    """Fly a checked batch; see `fleet.simulator.batch.fly`."""
    arrays = arrays_of(layout)
    scratch = _Scratch(
        todo=(layout.group_of >= 0).astype(np.uint8),
        visited=np.zeros(len(layout.groups), dtype=np.int64),
        utility=np.zeros(len(layout.groups)),
        path=np.empty(layout.grid.cells, dtype=np.int32),
    )
    flown = Flown.blank(len(batch), layout.agents, layout.grid.cells)
    b = _Batch(*(np.ascontiguousarray(getattr(batch, name)) for name in _Batch._fields[:-1]), np.uint64(batch.seed & (2**64 - 1)))
    f = _Flown(*(getattr(flown, name) for name in _Flown._fields))
    land_at = np.full((len(batch), layout.agents), -1, dtype=np.int64)
    _fly(arrays, b, f, scratch, land_at, None, None)
    return flown

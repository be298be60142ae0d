"""The compiled form of the simulator.

What makes it fast, by measurement:
- A flight runs alone to its end: its state stays in registers and in the nearest cache.
- Each row of scores is turned once into an order of preference, four bytes a cell.
- Cells that are not captured are bits in words, one word a row of a group: legal moves, captures and the nearest cell
  that is left are found by operations on words, mostly without branches.
- Within a group SA's loop asks about that group alone; every move leads to a cell that is captured on arrival.
- What a flight has touched is cleared along its path.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fleet.compiled import part as _part
from fleet.compiled import program as _program
from fleet.randomness import GOLDEN_GAMMA, MIX_1, MIX_2
from fleet.simulator.arrays import WORD_BITS
from fleet.simulator.bits import leading_zeros as _leading_zeros
from fleet.simulator.bits import trailing_zeros as _trailing_zeros

_int: Any = np.int64  # Any: numba's integers are not numpy's to a type checker
_word: Any = np.uint64
_GAMMA, _MIX_1, _MIX_2 = _word(GOLDEN_GAMMA), _word(MIX_1), _word(MIX_2)
_EXPLORE, _PICK = _word(0), _word(1)
_ONE = _word(1)
_FAR = _int(2**62)
_LEGAL = [[move for move in range(8) if bits >> move & 1] for bits in range(256)]
_COUNT = np.array([len(moves) for moves in _LEGAL], dtype=np.uint8)
"""Number of legal moves."""
_NTH = np.array([moves + [0] * (8 - len(moves)) for moves in _LEGAL], dtype=np.uint8)
"""The n-th legal move."""


class Scratch(NamedTuple):
    """What a flight remembers; clear between flights.

    Args:
        free: Bits of the cells with data that are not captured, uint64 [words].
        visited: V of each group, int64 [groups].
        utility: U of each group, float64 [groups].
        path: Captured cells in order, int32 [cells + 1].
    """

    free: NDArray[np.uint64]
    visited: NDArray[np.int64]
    utility: NDArray[np.float64]
    path: NDArray[np.int32]


class _Flight(NamedTuple):
    """What is fixed during a flight; `room` is the length of its trace."""

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
    room: int
    cells: NDArray[np.int32]
    captured: NDArray[np.bool_]
    legal: NDArray[np.uint8]
    move: NDArray[np.int8]
    left: NDArray[np.int64]


class _State(NamedTuple):
    """Where a flight is."""

    cell: int
    step: int
    captures: int
    decisions: int


@_part
def _mix(value: Any) -> Any:
    value = (value ^ (value >> _word(30))) * _MIX_1
    value = (value ^ (value >> _word(27))) * _MIX_2
    return value ^ (value >> _word(31))


@_part
def _absorb(state: Any, counter: Any) -> Any:
    return _mix((state ^ _word(counter)) + _GAMMA)


@_program
def rank(scores: Any, members: Any, moves: Any, orders: Any) -> Any:
    """Write each cell's moves from best to worst, three bits each, the first of equals first.

    Args:
        scores: float64 [P, cells, 8].
        members: Cells with data.
        moves: The moves that count.
        orders: Result, uint32 [P, cells].

    Returns:
        Index of the first table with a NaN; -1 when there is none.
    """
    broken = _int(-1)
    for table in range(len(scores)):
        for index in range(len(members)):
            cell = _word(members[index])
            order = _int(0)
            for move in range(len(moves)):
                score = scores[table, cell, move]
                place = _int(0)
                for other in range(len(moves)):
                    if other < move:
                        place += not score > scores[table, cell, other]
                    elif other > move:
                        place += scores[table, cell, other] > score
                order |= move << (3 * place)
                broken = table if np.isnan(score) and broken < 0 else broken
            orders[table, cell] = order
    return broken


@_part
def _nearest(layout: Any, free: Any, cell: Any, group: Any) -> Any:
    """The nearest cell of the group that is left, the first of equals: of each row the nearest bit, left or right."""
    aside = _int(layout.column[cell]) - layout.left[group]
    bit = min(max(aside, 0), WORD_BITS - 1)
    beyond = abs(aside - bit)
    top = _int(layout.top[group])
    below = top - layout.row[cell]
    corner = top * layout.columns + layout.left[group] + bit
    first = _int(layout.words[group])
    least = _FAR
    for row in range(layout.words[group + 1] - first):
        bits = free[_word(first + row)]
        right = _int(_trailing_zeros(bits >> _word(bit)))
        left = _int(_leading_zeros(bits << _word(WORD_BITS - 1 - bit)))
        distance = abs(below + row) + beyond + min(left, right)
        found = corner + row * layout.columns + (-left if left <= right else right)
        least = min(least, (distance << 32) + found if bits != 0 else _FAR)
    return least & 0xFFFFFFFF


@_part
def _travel(layout: Any, flight: Any, scratch: Any, state: Any, target: Any) -> Any:
    """Go to a cell, along the longer way that is left."""
    free, visited, utility, path = scratch
    cell, step, captures, decisions = state
    rows = _int(layout.row[target]) - layout.row[cell]
    columns = _int(layout.column[target]) - layout.column[cell]
    down, across = layout.compass[0 if rows > 0 else 1], layout.compass[2 if columns > 0 else 3]
    rows, columns = abs(rows), abs(columns)
    while cell != target:
        vertical = rows >= columns
        move = _word(down if vertical else across)
        rows -= vertical
        columns -= not vertical
        if step < flight.room:
            flight.move[step] = move
        flight.moves[move] += 1
        step += 1
        cell += layout.cell_steps[move]
        here = _word(cell)
        word, bit = _word(layout.word[here]), _word(layout.bit[here])
        captured = _int(free[word] >> bit) & _int(layout.capture_in_transit or cell == target) & 1
        group = _word(max(_int(layout.group_of[here]), 0))
        free[word] ^= _word(captured) << bit
        visited[group] += captured
        utility[group] += flight.rewards[here] if captured else 0.0
        path[_word(captures)] = cell
        captures += captured
        if step < flight.room:
            flight.cells[step] = cell
            flight.captured[step] = captured
    return _State(cell, step, captures, decisions)


@_part
def _explored(flight: Any, step: Any, legal: Any, best: Any) -> Any:
    """The best move, or now and then a random one."""
    here = _absorb(flight.stream, step)
    bits = _mix(_absorb(here, _EXPLORE) + _GAMMA)
    if np.float64(bits >> _word(11)) * 2.0**-53 < flight.exploration:
        pick = _mix(_absorb(here, _PICK) + _GAMMA) % _word(_COUNT[legal])
        best = _int(_NTH[legal, pick])
    return best


@_part
def _legal(layout: Any, free: Any, inside: Any, word: Any, bit: Any) -> Any:
    """Moves that stay in the group and lead to a cell that is not captured, as bits."""
    legal = _int(0)
    for move in range(len(layout.moves)):
        row = free[_word(word + layout.row_steps[move])]
        there = row >> _word((bit + layout.column_steps[move]) & (WORD_BITS - 1))
        legal |= (_int(there) & (inside >> move) & 1) << move
    return legal


@_part
def _best(layout: Any, order: Any, legal: Any) -> Any:
    """The first legal move in an order of preference."""
    best = _int(0)
    for place in range(len(layout.moves) - 1, -1, -1):
        move = (order >> (3 * place)) & 7
        best = move if (legal >> move) & 1 else best
    return best


@_part
def _roam(layout: Any, flight: Any, scratch: Any, state: Any, group: Any) -> Any:
    """Let SA move within the group until it is done, which gives True, or until no move is legal."""
    free, visited, utility, path = scratch
    cell, step, captures, decisions = state
    size = _int(layout.sizes[group])
    limit = flight.t_v + 1 if flight.t_v < size else size
    v, u = visited[group], utility[group]
    word, bit = _int(layout.word[cell]), _int(layout.bit[cell])
    done = False
    while not done:
        inside = _int(flight.inside[_word(cell)])
        order = _int(flight.order[_word(cell)])
        legal = _legal(layout, free, inside, word, bit)
        if legal == 0:
            break
        best = _best(layout, order, legal)
        if flight.exploration > 0 and legal & (legal - 1):
            best = _explored(flight, step, legal, best)
        if step < flight.room:
            flight.legal[step] = legal
            flight.move[step] = best
        way = _word(best)
        flight.moves[way] += 1
        decisions += 1
        step += 1
        cell += layout.cell_steps[way]
        word += layout.row_steps[way]
        bit += layout.column_steps[way]
        free[_word(word)] &= ~(_ONE << _word(bit))
        path[_word(captures)] = cell
        captures += 1
        v += 1
        u += flight.rewards[_word(cell)]
        if step < flight.room:
            flight.cells[step] = cell
            flight.captured[step] = True
        done = v >= limit or u > flight.t_u
    visited[group] = v
    utility[group] = u
    return _State(cell, step, captures, decisions), done


@_part
def _take_off(layout: Any, flight: Any, scratch: Any, away: Any) -> Any:
    """The first state, captured when it may be; `away` when it is not in the agent's first group."""
    cell = _int(layout.starts[flight.agent])
    word, bit = layout.word[cell], _word(layout.bit[cell])
    captured = _int(scratch.free[word] >> bit) & _int(layout.capture_in_transit or not away) & 1
    scratch.free[word] ^= _word(captured) << bit
    scratch.visited[max(layout.group_of[cell], 0)] += captured
    scratch.path[0] = cell
    if flight.room > 0:
        flight.cells[0] = cell
        flight.captured[0] = captured
    return _State(cell, _int(0), captures=captured, decisions=_int(0))


@_part
def _is_done(layout: Any, flight: Any, scratch: Any, group: Any) -> Any:
    visited = scratch.visited[group]
    return visited == layout.sizes[group] or scratch.utility[group] > flight.t_u or visited > flight.t_v


@_part
def _fly_one(layout: Any, flight: Any, scratch: Any) -> Any:
    """One flight from take-off to landing: its last state and the number of groups that are behind it."""
    first, last = _int(layout.first[flight.agent]), _int(layout.last[flight.agent])
    group, leavings = first, 0
    astray = layout.group_of[layout.starts[flight.agent]] != group
    state = _take_off(layout, flight, scratch, astray)
    while True:
        if astray:
            state = _travel(layout, flight, scratch, state, _nearest(layout, scratch.free, state.cell, group))
        before = group
        while group < last and _is_done(layout, flight, scratch, group):
            group += 1
        if group == last:
            break
        if group != before:
            if leavings < len(flight.left):
                flight.left[leavings] = state.step
                leavings += 1
            if state.step == flight.land_at:
                break
        astray = True
        if layout.group_of[state.cell] == group:
            state, done = _roam(layout, flight, scratch, state, group)
            astray = not done
    return state, group - first


@_program
def fly(layout: Any, batch: Any, flown: Any, trace: Any, scratch: Any) -> None:
    """Fly all missions of a batch; the arrays of `flown` and `trace` are blank, those of `scratch` clear."""
    seeded = _mix(batch.seed + _GAMMA)
    for mission in range(len(batch.missions)):
        stream = _absorb(seeded, batch.missions[mission])
        for agent in range(len(layout.starts)):
            flight = _Flight(
                agent=agent,
                t_u=batch.utility_thresholds[mission],
                t_v=batch.visited_thresholds[mission],
                exploration=batch.exploration[mission],
                stream=_absorb(stream, agent),
                land_at=batch.land_at[mission, agent],
                inside=layout.inside[layout.set_of[agent]],
                order=batch.orders[batch.table[mission, agent]],
                rewards=batch.rewards[batch.reward_of[mission]],
                moves=flown.moves[mission, agent],
                room=trace.cell.shape[2],
                cells=trace.cell[mission, agent],
                captured=trace.captured[mission, agent],
                legal=trace.legal[mission, agent],
                move=trace.move[mission, agent],
                left=trace.left[mission, agent],
            )
            state, explored = _fly_one(layout, flight, scratch)
            flown.steps[mission, agent] = state.step + 1
            flown.captures[mission, agent] = state.captures
            flown.decisions[mission, agent] = state.decisions
            flown.groups_explored[mission, agent] = explored
            for index in range(state.captures):
                cell = _word(scratch.path[_word(index)])
                word, group = _word(layout.word[cell]), _word(layout.group_of[cell])
                flown.captured[mission, cell] = True
                scratch.free[word] = layout.full[word]
                scratch.visited[group] = 0
                scratch.utility[group] = 0.0

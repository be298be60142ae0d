"""Who flies where: state groups in their order, one part of them for each agent.

Each agent has a run of consecutive groups such that all agents have nearly the same number of cells with data.
Source: paper, section "State-To-Action and History-To-Action Models" (state groups).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.grid import Grid
from fleet.errors import MissionError
from fleet.spec.learning import SAKind
from fleet.spec.resources import Fleet
from fleet.spec.swarm import Action, AgentSpec, GroupOrder, StateSpace

MOVES = tuple(Action)
"""Every move; the index of a move in traces, legal masks and score tables."""


@dataclass(frozen=True, eq=False)
class Layout:
    """The fixed part of a mission over one grid.

    Args:
        grid: The states.
        groups: Cells with data of each state group, in the order of visit; int64 arrays.
        group_of: Group of each cell, int64 [cells]; -1 for a cell without data.
        parts: For each agent the first and the past-the-end index into `groups`.
        starts: Take-off cell of each agent.
        actions: Moves of each agent that SA may choose, as indices into MOVES.
        capture_in_transit: Whether cells on the way to the next group are captured.
    """

    grid: Grid
    groups: tuple[NDArray[np.int64], ...]
    group_of: NDArray[np.int64]
    parts: tuple[tuple[int, int], ...]
    starts: tuple[int, ...]
    actions: tuple[tuple[int, ...], ...]
    capture_in_transit: bool

    @property
    def agents(self) -> int:
        """Number of agents."""
        return len(self.parts)


def layout_of(grid: Grid, fleet: Fleet, agents: Sequence[AgentSpec] | None = None) -> Layout:
    """The layout in which a fleet flies over a grid.

    Args:
        agents: Who flies; the fleet's agents when left out.
    Raises:
        MissionError: the agents do not fit on the grid.
    """
    agents = fleet.agents.resolved if agents is None else agents
    if fleet.sa.kind is SAKind.PLANNER:
        return plan_field(grid, agents)
    return plan_layout(grid, fleet.state_space, agents)


def plan_layout(grid: Grid, space: StateSpace, agents: Sequence[AgentSpec]) -> Layout:
    """Form groups, order them, and give each agent its part.

    Raises:
        MissionError: there are fewer groups with data than agents, or a start is outside the grid.
    """
    groups = form_groups(grid, space.groups.rows, space.groups.columns, space.groups.order)
    if len(groups) < len(agents):
        raise MissionError(
            f"{len(agents)} agents but only {len(groups)} state groups with data; use fewer agents or smaller groups"
        )
    group_of = np.full(grid.cells, -1, dtype=np.int64)
    for index, cells in enumerate(groups):
        group_of[cells] = index
    parts = divide([len(cells) for cells in groups], len(agents))
    starts = tuple(_start(grid, agent, groups[first]) for agent, (first, _) in zip(agents, parts, strict=True))
    actions = tuple(_actions(agent) for agent in agents)
    return Layout(grid, groups, group_of, parts, starts, actions, space.capture_in_transit)


def plan_field(grid: Grid, agents: Sequence[AgentSpec]) -> Layout:
    """The layout of agents that may fly anywhere: a part of the field for each to take off in, as its one group.

    An agent without a start takes off in the middle of its part.

    Raises:
        MissionError: there are fewer cells with data than agents, or a start is outside the grid.
    """
    from fleet.missions.partition import middle, parts  # noqa: PLC0415 - scipy loads only for those who plan

    groups = parts(grid, len(agents))
    group_of = np.full(grid.cells, -1, dtype=np.int64)
    for index, cells in enumerate(groups):
        group_of[cells] = index
    middles = [np.array([middle(grid, cells)]) for cells in groups]
    return Layout(
        grid=grid,
        groups=groups,
        group_of=group_of,
        parts=tuple((index, index + 1) for index in range(len(agents))),
        starts=tuple(_start(grid, agent, first) for agent, first in zip(agents, middles, strict=True)),
        actions=tuple(_actions(agent) for agent in agents),
        capture_in_transit=True,
    )


def form_groups(grid: Grid, rows: int, columns: int, order: GroupOrder) -> tuple[NDArray[np.int64], ...]:
    """Blocks of rows x columns cells, in order, without cells that have no data and without empty blocks.

    Returns:
        The cells of each group, ascending.
    """
    blocks: dict[tuple[int, int], NDArray[np.int64]] = {}
    numbers = np.arange(grid.cells, dtype=np.int64).reshape(grid.rows, grid.columns)
    for top in range(0, grid.rows, rows):
        for left in range(0, grid.columns, columns):
            window = (slice(top, top + rows), slice(left, left + columns))
            cells = numbers[window][grid.valid[window]]
            if len(cells):
                blocks[top // rows, left // columns] = cells
    return tuple(blocks[key] for key in _ordered(list(blocks), order))


def _ordered(keys: list[tuple[int, int]], order: GroupOrder) -> list[tuple[int, int]]:
    match order:
        case GroupOrder.ROW_MAJOR:
            return sorted(keys)
        case GroupOrder.SERPENTINE:
            return sorted(keys, key=lambda key: (key[0], key[1] if key[0] % 2 == 0 else -key[1]))
        case GroupOrder.COLUMN_SERPENTINE:
            return sorted(keys, key=lambda key: (key[1], key[0] if key[1] % 2 == 0 else -key[0]))
        case GroupOrder.NEAREST:
            return _nearest_chain(sorted(keys))


def _nearest_chain(keys: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Start at the first and always go to the nearest one that is left; the first of equals."""
    chain = keys[:1]
    left = keys[1:]
    while left:
        row, column = chain[-1]
        nearest = min(left, key=lambda key: (abs(key[0] - row) + abs(key[1] - column), key))
        left.remove(nearest)
        chain.append(nearest)
    return chain


def divide(sizes: Sequence[int], parts: int) -> tuple[tuple[int, int], ...]:
    """Cut a sequence of groups into consecutive, non-empty parts of nearly equal total size.

    Returns:
        First and past-the-end index of each part.
    """
    ends = np.cumsum(sizes)
    cuts = [0]
    for part in range(1, parts):
        ideal = ends[-1] * part / parts
        cut = int(np.argmin(np.abs(ends - ideal))) + 1
        cuts.append(min(max(cut, cuts[-1] + 1), len(sizes) - (parts - part)))
    return tuple(pairwise([*cuts, len(sizes)]))


def _actions(agent: AgentSpec) -> tuple[int, ...]:
    return tuple(sorted({MOVES.index(action) for action in agent.actions or ()}))


def _start(grid: Grid, agent: AgentSpec, first_group: NDArray[np.int64]) -> int:
    if agent.start is None:
        return int(first_group[0])
    row, column = agent.start.row, agent.start.column
    if row >= grid.rows or column >= grid.columns:
        raise MissionError(
            f"{agent.name}: start row {row}, column {column} is outside of the context's "
            f"{grid.rows} rows and {grid.columns} columns"
        )
    return grid.cell(row, column)

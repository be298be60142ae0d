"""Who flies where."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.contexts.grid import Grid
from fleet.errors import MissionError
from fleet.missions.layout import divide, form_groups, plan_layout
from fleet.spec.swarm import CARDINAL, Action, AgentSpec, GroupOrder, Groups, Start, StateSpace

FULL = Grid(np.ones((4, 6), dtype=np.bool_))


def space(rows: int = 2, columns: int = 2, order: GroupOrder = GroupOrder.SERPENTINE) -> StateSpace:
    return StateSpace(context="field", groups=Groups(rows=rows, columns=columns, order=order))


def agent(name: str, start: Start | None = None) -> AgentSpec:
    return AgentSpec(name=name, actions=CARDINAL, start=start)


@pytest.mark.parametrize(
    ("order", "firsts"),
    [
        (GroupOrder.ROW_MAJOR, [0, 2, 4, 12, 14, 16]),
        (GroupOrder.SERPENTINE, [0, 2, 4, 16, 14, 12]),
        (GroupOrder.COLUMN_SERPENTINE, [0, 12, 14, 2, 4, 16]),
        (GroupOrder.NEAREST, [0, 2, 4, 16, 14, 12]),
    ],
)
def test_groups_come_in_the_order_that_the_spec_names(order: GroupOrder, firsts: list[int]) -> None:
    assert [int(group[0]) for group in form_groups(FULL, 2, 2, order)] == firsts


def test_blocks_without_data_are_no_groups_and_blocks_at_the_edge_are_smaller() -> None:
    valid = np.ones((3, 3), dtype=np.bool_)
    valid[:2, :2] = False
    groups = form_groups(Grid(valid), 2, 2, GroupOrder.ROW_MAJOR)
    assert [group.tolist() for group in groups] == [[2, 5], [6, 7], [8]]


def test_each_agent_gets_a_run_of_groups_and_takes_off_in_its_first_cell() -> None:
    layout = plan_layout(FULL, space(), [agent("a"), agent("b")])
    assert layout.parts == ((0, 3), (3, 6))
    assert layout.starts == (0, 16)
    assert layout.agents == 2
    assert layout.group_of.reshape(4, 6).tolist() == [[0, 0, 1, 1, 2, 2]] * 2 + [[5, 5, 4, 4, 3, 3]] * 2


def test_a_start_of_its_own_may_be_anywhere_on_the_grid() -> None:
    layout = plan_layout(FULL, space(), [agent("a"), agent("b", Start(row=0, column=5))])
    assert layout.starts == (0, 5)


def test_actions_are_sorted_and_named_once() -> None:
    spec = AgentSpec(name="a", actions=(Action.WEST, Action.NORTH, Action.WEST))
    assert plan_layout(FULL, space(), [spec]).actions == ((0, 3),)


def test_a_start_beyond_the_grid_is_refused() -> None:
    with pytest.raises(
        MissionError, match=r"b: start row 4, column 0 is outside of the context's 4 rows and 6 columns"
    ):
        plan_layout(FULL, space(), [agent("a"), agent("b", Start(row=4, column=0))])


def test_more_agents_than_groups_are_refused() -> None:
    with pytest.raises(MissionError, match="3 agents but only 2 state groups"):
        plan_layout(FULL, space(rows=4, columns=3), [agent("a"), agent("b"), agent("c")])


def test_a_huge_group_leaves_the_others_their_parts() -> None:
    assert divide([100, 1, 1], 3) == ((0, 1), (1, 2), (2, 3))
    assert divide([1, 1, 100], 3) == ((0, 1), (1, 2), (2, 3))

from __future__ import annotations

import pytest

from fleet.missions.history import ThresholdHA


@pytest.mark.parametrize(
    ("utility", "visited", "moves_on"),
    [(0.0, 0, False), (2.0, 4, False), (2.01, 0, True), (0.0, 5, True), (3.0, 9, True)],
)
def test_an_agent_leaves_a_group_only_above_a_threshold(utility: float, visited: int, moves_on: bool) -> None:
    assert ThresholdHA(utility_threshold=2.0, visited_threshold=4).moves_on(utility, visited) is moves_on


def test_thresholds_of_zero_let_an_agent_make_one_capture() -> None:
    ha = ThresholdHA(0.0, 0)
    assert (ha.moves_on(0.0, 0), ha.moves_on(0.0, 1)) == (False, True)


def test_each_threshold_can_be_asked_alone() -> None:
    ha = ThresholdHA(2.0, 4)
    assert [(ha.is_useful_enough(2.0), ha.is_seen_enough(4)), (ha.is_useful_enough(2.01), ha.is_seen_enough(5))] == [
        (False, False),
        (True, True),
    ]

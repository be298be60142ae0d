"""Waits between attempts grow, differ, follow the server's wish, and end."""

from __future__ import annotations

import itertools

from fleet.clock import ManualClock
from fleet.storage.limits import within
from fleet.storage.patience import Patience


def waits(total_s: float, chance: float = 1.0, at_least_s: float = 0.0) -> list[float]:
    clock = ManualClock()
    patience = Patience(total_s, 0.5, 4.0, now=clock.now, sleep=clock.sleep, chance=lambda: chance)
    times = [clock.now() for _ in itertools.takewhile(lambda _: patience.wait(at_least_s), itertools.count())]
    return [after - before for before, after in itertools.pairwise([0.0, *times])]


def test_each_wait_is_twice_the_one_before_up_to_the_longest_and_the_last_one_ends_in_time() -> None:
    assert waits(20.0) == [0.5, 1.0, 2.0, 4.0, 4.0, 4.0, 4.0, 0.5]


def test_waits_of_many_spread_over_half_of_their_length() -> None:
    assert waits(1.0, chance=0.0) == [0.25, 0.5, 0.25]


def test_the_server_is_given_the_time_that_it_asks_for() -> None:
    assert waits(5.0, at_least_s=3.0) == [3.0, 2.0]


def test_without_patience_there_is_one_attempt() -> None:
    assert waits(0.0) == []


def test_there_is_no_wait_beyond_which_the_process_may_not_go_on() -> None:
    clock = ManualClock()
    patience = Patience(60.0, 0.5, 4.0, now=clock.now, sleep=clock.sleep, chance=lambda: 1.0)
    with within(1.0):
        assert (patience.wait(), patience.wait(), clock.now()) == (True, False, 0.5)

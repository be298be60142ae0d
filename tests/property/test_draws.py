"""Draws depend on every counter and on its place."""

from __future__ import annotations

from hypothesis import assume, given
from hypothesis import strategies as st

from fleet.randomness import draw, uniform

COUNTERS = st.lists(st.integers(0, 2**64 - 1), min_size=1, max_size=5)


@given(COUNTERS, COUNTERS)
def test_two_places_draw_differently(one: list[int], other: list[int]) -> None:
    assume(one != other)
    assert draw(*one) != draw(*other)


def test_seeds_share_no_missions() -> None:
    draws = [draw(seed, mission) for seed in range(64) for mission in range(64)]
    assert len(set(draws)) == len(draws)


@given(st.integers(), COUNTERS)
def test_uniform_is_below_one_and_only_the_low_64_bits_count(seed: int, counters: list[int]) -> None:
    value = uniform(seed, *counters)
    assert 0.0 <= value < 1.0
    assert value == uniform(seed % 2**64, *counters)

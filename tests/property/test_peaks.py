"""Peaks along a row."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.functions.stalks import peaks

HEIGHTS = st.lists(st.integers(0, 9), min_size=1, max_size=30)


def plain_peaks(values: list[int], step: float) -> list[int]:
    """Value by value: a peak is the highest place between a rise and a fall by more than `step`."""
    found: list[int] = []
    low, high, place, rising = 0.0, 0.0, -1, True
    for index, value in enumerate([*values, 0]):
        if rising:
            if value > high:
                high, place = value, index
            if high - low > step and high - value > step:
                found.append(place)
                rising, low = False, value
        else:
            low = min(low, value)
            if value - low > step:
                rising, high, place = True, value, index
    return found


@settings(max_examples=300)
@given(HEIGHTS, st.sampled_from([0.5, 1.5, 3.0]))
def test_peaks_are_those_of_the_plain_scan(values: list[int], step: float) -> None:
    assert len(peaks(np.array(values), step)) == len(plain_peaks(values, step))


@settings(max_examples=100)
@given(st.integers(0, 12), st.integers(1, 5), st.integers(1, 5))
def test_equal_bumps_are_counted(bumps: int, width: int, gap: int) -> None:
    row = ([0.0] * gap + [5.0] * width) * bumps + [0.0] * gap
    assert len(peaks(np.array(row), 1.0)) == bumps

from __future__ import annotations

import math
from decimal import ROUND_HALF_UP, Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.spec.platform import UsefulnessScale
from fleet_operator.policy.level import level, levels, priority_value

ABSOLUTE, RELATIVE = UsefulnessScale.ABSOLUTE, UsefulnessScale.RELATIVE
scales = st.sampled_from(UsefulnessScale)
shares = st.floats(0, 1)


@pytest.mark.parametrize(
    ("usefulness", "expected"),
    [(0.0, 0), (0.049, 0), (0.05, 1), (0.149, 1), (0.15, 2), (0.5, 5), (0.85, 9), (0.95, 9), (1.0, 9)],
)
def test_the_absolute_level_is_ten_times_the_usefulness_with_halves_up_and_at_most_nine(
    usefulness: float, expected: int
) -> None:
    assert level(usefulness, ABSOLUTE, 1.0) == expected


def test_the_relative_level_divides_by_the_largest() -> None:
    known = {"initial": 0.004, "1": 0.002, "2": 0.0001, "3": 0.0, "4": None}
    assert levels(known, RELATIVE) == {"initial": 9, "1": 5, "2": 0, "3": 0, "4": 1}
    assert levels(known, ABSOLUTE) == {"initial": 0, "1": 0, "2": 0, "3": 0, "4": 1}


def test_relative_levels_are_zero_when_nothing_is_useful() -> None:
    assert levels({"1": 0.0, "2": None}, RELATIVE) == {"1": 0, "2": 1}
    assert levels({}, RELATIVE) == {}


@given(scales, shares)
def test_what_was_never_evaluated_is_trained_at_least_once(scale: UsefulnessScale, largest: float) -> None:
    assert level(None, scale, largest) >= 1


@given(scales, st.lists(shares, min_size=1, max_size=8))
def test_levels_are_0_to_9_and_keep_the_order(scale: UsefulnessScale, values: list[float]) -> None:
    found = [level(value, scale, max(values)) for value in sorted(values)]
    assert found == sorted(found)
    assert 0 <= found[0] <= found[-1] <= 9


@given(st.integers(0, 1000))
def test_the_absolute_level_is_the_papers_rounding(thousandths: int) -> None:
    exact = Decimal(thousandths) / 1000
    expected = min(9, int((exact * 10).quantize(Decimal(1), ROUND_HALF_UP)))
    found = level(thousandths / 1000, ABSOLUTE, 1.0)
    assert found == expected or (exact * 10) % 1 == Decimal("0.5")  # a half that binary numbers cannot write


@given(st.one_of(st.floats(max_value=-1e-9), st.floats(min_value=1.0000001), st.just(math.nan)), scales)
def test_usefulness_outside_of_0_to_1_is_refused(value: float, scale: UsefulnessScale) -> None:
    with pytest.raises(ValueError, match="outside of"):
        level(value, scale, 1.0)
    with pytest.raises(ValueError, match="outside of"):
        level(None, scale, value)


def test_usefulness_above_the_largest_is_refused() -> None:
    with pytest.raises(ValueError, match="above the largest"):
        level(0.5, RELATIVE, 0.4)


def test_priorities_are_steps_of_a_hundred_million() -> None:
    assert [priority_value(each) for each in (0, 1, 9, 10)] == [0, 100_000_000, 900_000_000, 1_000_000_000]
    for wrong in (-1, 11):
        with pytest.raises(ValueError, match="outside"):
            priority_value(wrong)

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet_operator.policy.shares import Capacity, Share, shares, shares_of_the_rest, water_fill

GIB = 2**30
keyed_levels = st.dictionaries(st.text("ab123-", min_size=1, max_size=4), st.integers(0, 9), max_size=20)
amounts = st.floats(0, 1e6)


def naive(levels: dict[str, int], total: float, cap: float) -> dict[str, float]:
    """Water-filling as one would say it: give each its part, cut at the cap, start again with those below it."""
    full: set[str] = set()
    while True:
        rest = {key: level for key, level in levels.items() if level > 0 and key not in full}
        left = max(0.0, total - cap * len(full))
        part = {key: left * level / sum(rest.values()) for key, level in rest.items()}
        over = {key for key, amount in part.items() if amount > cap}
        if not over:
            return {**dict.fromkeys(full, cap), **part}
        full |= over


def test_shares_are_the_papers_when_no_node_is_too_small() -> None:
    found = shares({"1": 3, "1-2": 1, "2": 0}, Capacity(8, 8 * GIB), Capacity(8, 8 * GIB))
    assert found == {
        "1": Share(Capacity(6.0, 6 * GIB), Capacity(0.6000000000000001, math.floor(6 * GIB * 0.1))),
        "1-2": Share(Capacity(2.0, 2 * GIB), Capacity(0.2, math.floor(2 * GIB * 0.1))),
    }


def test_what_the_largest_node_cannot_hold_goes_to_the_others() -> None:
    assert water_fill({"a": 9, "b": 2, "c": 1}, 12.0, 4.0) == {"a": 4.0, "b": 4.0, "c": 4.0}
    assert water_fill({"a": 9, "b": 2, "c": 1}, 9.0, 4.0) == pytest.approx({"a": 4.0, "b": 10 / 3, "c": 5 / 3})


def test_nothing_is_divided_among_nobody() -> None:
    assert shares({}, Capacity(4, GIB), Capacity(4, GIB)) == {}
    assert shares({"a": 0}, Capacity(4, GIB), Capacity(4, GIB)) == {}


@given(keyed_levels, amounts, amounts)
def test_water_filling_is_the_naive_one(levels: dict[str, int], total: float, cap: float) -> None:
    assert water_fill(levels, total, cap) == pytest.approx(naive(levels, total, cap), rel=1e-9, abs=1e-6)


@given(keyed_levels, amounts, amounts)
def test_shares_use_all_there_is_and_no_more(levels: dict[str, int], total: float, cap: float) -> None:
    found = water_fill(levels, total, cap)
    assert set(found) == {key for key, level in levels.items() if level > 0}
    assert all(0 <= amount <= cap for amount in found.values())
    assert sum(found.values()) == pytest.approx(min(total, cap * len(found)), rel=1e-9, abs=1e-6)


@given(keyed_levels, amounts, amounts)
def test_a_higher_level_never_gets_less(levels: dict[str, int], total: float, cap: float) -> None:
    found = water_fill(levels, total, cap)
    ordered = [found[key] for key in sorted(found, key=lambda key: levels[key])]
    assert all(low <= high * (1 + 1e-9) + 1e-9 for low, high in pairwise(ordered))


@given(keyed_levels, st.floats(0, 64), st.integers(0, 2**40))
def test_requests_are_small_and_below_limits(levels: dict[str, int], cores: float, memory: int) -> None:
    total = Capacity(cores, memory)
    for share in shares(levels, total, total).values():
        assert share.request.cores <= share.limit.cores
        assert share.request.memory_bytes <= share.limit.memory_bytes
        assert share.request.cores <= max(0.05, share.limit.cores * 0.1)


@given(keyed_levels, st.data())
def test_nobody_gets_less_when_others_have_finished(levels: dict[str, int], data: st.DataObject) -> None:
    finished = data.draw(st.sets(st.sampled_from(sorted(levels)))) if levels else set()
    total, largest = Capacity(8, 8 * GIB), Capacity(4, 4 * GIB)
    before, after = shares(levels, total, largest), shares_of_the_rest(levels, finished, total, largest)
    assert set(after) == set(before) - finished
    for key, share in after.items():
        assert share.limit.cores >= before[key].limit.cores * (1 - 1e-9)
        assert share.limit.memory_bytes >= before[key].limit.memory_bytes - 1


def test_wrong_levels_and_capacities_are_refused() -> None:
    with pytest.raises(ValueError, match=r"levels are 0\.\.9"):
        shares({"a": 10}, Capacity(1, 1), Capacity(1, 1))
    for wrong in (-1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="finite and not negative"):
            water_fill({"a": 1}, wrong, 1.0)
        with pytest.raises(ValueError, match="finite and not negative"):
            water_fill({"a": 1}, 1.0, wrong)

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from fleet.spec.platform import Pruning
from fleet_operator.policy.pruning import pruned

histories = st.lists(st.dictionaries(st.sampled_from("abc"), st.none() | st.floats(0, 1)), max_size=8)
rules = st.builds(Pruning, below=st.floats(0, 1), after=st.integers(1, 4))


def rule(below: float, after: int) -> Pruning:
    return Pruning(below=below, after=after)


def test_a_model_is_pruned_after_so_many_missions_in_a_row_under_the_threshold() -> None:
    history = [{"a": 0.05, "b": 0.05}, {"a": 0.09, "b": 0.1}, {"a": 0.5, "b": 0.0}]
    assert pruned(history[:1], rule(0.1, 2)) == frozenset()
    assert pruned(history[:2], rule(0.1, 2)) == {"a"}
    assert pruned(history, rule(0.1, 2)) == {"a"}  # pruned for good


def test_missions_in_which_a_model_had_not_flown_neither_count_nor_break_the_row() -> None:
    assert pruned([{"a": None}, {"a": None}, {"a": None}], rule(0.1, 2)) == frozenset()
    assert pruned([{"a": 0.0}, {"a": None}, {}, {"a": 0.0}], rule(0.1, 2)) == {"a"}


@given(histories, st.integers(1, 4))
def test_a_threshold_of_zero_prunes_nothing(history: list[dict[str, float | None]], after: int) -> None:
    assert pruned(history, rule(0.0, after)) == frozenset()


@given(histories, rules)
def test_pruned_models_stay_pruned(history: list[dict[str, float | None]], rules: Pruning) -> None:
    found = [pruned(history[:end], rules) for end in range(len(history) + 1)]
    assert all(earlier <= later for earlier, later in pairwise(found))


@given(histories, rules)
def test_a_model_that_was_never_under_the_threshold_is_kept(
    history: list[dict[str, float | None]], rules: Pruning
) -> None:
    under = {key for each in history for key, value in each.items() if value is not None and value < rules.below}
    assert pruned(history, rules) <= under

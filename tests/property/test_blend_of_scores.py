from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.errors import ModelError
from fleet.learning.blend import blend

keys = st.sampled_from(["initial", "1", "2", "1-2", "3"])
weights = st.dictionaries(keys, st.floats(0.0, 1.0), min_size=1).filter(lambda found: any(found.values()))


@given(weights, st.integers(0, 2**32 - 1))
def test_a_blend_is_the_weighted_sum_and_one_row_blends_as_among_many(found: dict[str, float], seed: int) -> None:
    generator = np.random.default_rng(seed)
    scores = {key: generator.normal(size=(9, 8)) for key in found}
    together = blend(scores, found)
    np.testing.assert_allclose(together, sum(scores[key] * found[key] for key in found), atol=2e-9)
    alone = np.vstack([blend({key: rows[i : i + 1] for key, rows in scores.items()}, found) for i in range(9)])
    np.testing.assert_array_equal(together, alone)
    backwards = {key: found[key] for key in reversed(list(found))}
    np.testing.assert_array_equal(blend(scores, backwards), together)


def test_a_model_without_weight_needs_no_scores() -> None:
    one = np.array([1.0, 2.0])
    np.testing.assert_array_equal(blend({"initial": one}, {"initial": 1.0, "1": 0.0}), one)


def test_a_weight_without_scores_is_an_error_that_names_the_model() -> None:
    with pytest.raises(ModelError, match="no scores of 1-2 to blend; there are initial"):
        blend({"initial": np.zeros(8)}, {"initial": 0.5, "1-2": 0.5})
    with pytest.raises(ModelError, match="no model has a weight"):
        blend({"initial": np.zeros(8)}, {"initial": 0.0})

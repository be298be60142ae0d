"""What Map() and Eval() may answer."""

from __future__ import annotations

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from fleet.contexts.grid import Grid
from fleet.functions.checks import AnswerError, check_evaluation, check_ssv
from fleet.functions.contract import Evaluation

GRID = Grid(np.ones((2, 3), dtype=bool))


def test_numbers_of_any_kind_are_taken_in_the_order_of_the_features() -> None:
    answer = {"b": np.float32(0.5), "a": 3, "c": Fraction(1, 4), "d": np.array(2.0)}
    features, values = check_ssv(answer, ("a", "b", "c", "d"))
    assert (features, values.tolist(), values.dtype) == (("a", "b", "c", "d"), [3.0, 0.5, 0.25, 2.0], np.float64)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, "answered None instead of features by name; return a dict such as {'height': 1.5}"),
        ({}, "answered no features; return at least one"),
        ({1: 2.0}, "answered a feature whose name is 1; names are texts"),
        ({"": 2.0}, "answered a feature whose name is ''; names are texts"),
        ({"a": None}, "feature a is None; return a number"),
        ({"a": np.zeros(2)}, "feature a is a ndarray; return a number"),
        ({"a": Decimal(1)}, "feature a is a Decimal; return a number"),
        ({"a": np.True_}, "feature a is True, a truth value; return a number (1.0 or 0.0)"),
        (
            {"a": 10**400},
            "feature a is inf; return a finite number, or a neutral value when there is nothing to measure",
        ),
        (
            {"a": -np.inf},
            "feature a is -inf; return a finite number, or a neutral value when there is nothing to measure",
        ),
    ],
)
def test_everything_else_is_refused(answer: object, message: str) -> None:
    with pytest.raises(AnswerError) as caught:
        check_ssv(answer, None)
    assert str(caught.value) == message


def test_many_missing_features_are_shortened() -> None:
    with pytest.raises(AnswerError) as caught:
        check_ssv({"z": 1.0}, tuple(f"f{i}" for i in range(12)))
    assert str(caught.value) == (
        "answered 1 features instead of 12: without f0, f1, f2, f3, f4, f5, f6, f7 and 4 more and with unknown z; "
        "every SSV of a Map() has the same features"
    )


def test_the_papers_triple_is_an_evaluation() -> None:
    found = check_evaluation((np.bool_(True), {"accuracy": np.float32(0.5)}, {"map": [[1, 2, None], [3, 4, 5]]}), GRID)
    assert (found.finished, found.metrics) == (True, {"accuracy": 0.5})
    np.testing.assert_array_equal(found.artefacts["map"], [[1.0, 2.0, np.nan], [3.0, 4.0, 5.0]])


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, "answered None instead of an Evaluation; return Evaluation(finished, metrics)"),
        (Evaluation(1, {}), "answered a int for `finished`; return True or False"),  # type: ignore[arg-type]  # the test
        (Evaluation(True, [1.0]), "answered a list for `metrics`; return a dict from names to numbers"),  # type: ignore[arg-type]  # the test
        (
            Evaluation(True, {"mae": float("nan")}),
            "metric mae is nan; return a finite number, or a neutral value when there is nothing to measure",
        ),
        (
            Evaluation(True, {}, {"map": np.zeros((3, 2))}),
            "artefact map is 3 x 2; return a grid of 2 rows x 3 columns",
        ),
        (
            Evaluation(True, {}, {"map": np.full((2, 3), np.inf)}),
            "artefact map has infinite values; use NaN where nothing is known",
        ),
        (
            Evaluation(True, {}, {"map": "picture"}),  # type: ignore[dict-item]  # the test
            "artefact map is not a grid of numbers: could not convert string to float: 'picture'",
        ),
        (
            Evaluation(True, {f"m{i}": 1.0 for i in range(2000)}),
            "answered 2000 metrics; an evaluation has at most 1024",
        ),
    ],
)
def test_what_is_no_evaluation_is_refused(answer: object, message: str) -> None:
    with pytest.raises(AnswerError) as caught:
        check_evaluation(answer, GRID)
    assert str(caught.value) == message

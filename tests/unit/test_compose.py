"""Map() as a composition of extractors."""

from __future__ import annotations

import pickle

import pytest

from fleet.contexts.base import Observation
from fleet.functions.compose import ExtractorError, Feature, compose, declared, extractor
from fleet.functions.contract import SSV

OBSERVATION = Observation(3, "cell 3", attributes={"a": 2.0})


@extractor(Feature("state", "1", 0.0), "twice")
def numbers(observation: Observation) -> SSV:
    return {"state": float(observation.state), "twice": 2.0 * observation.state}


def plain(observation: Observation) -> SSV:
    return {"a": observation.attributes["a"]}


@extractor("b")
def mistaken(observation: Observation) -> SSV:
    return {"c": 1.0}


def again(observation: Observation) -> SSV:
    return {"a": 1.0}


def fails(observation: Observation) -> SSV:
    raise LookupError("no sensor")


def listed(observation: Observation) -> SSV:
    return [1.0]  # type: ignore[return-value]  # what a user may do wrong


def test_the_ssv_has_all_features_in_the_order_of_the_extractors() -> None:
    assert list(compose(plain, numbers)(OBSERVATION).items()) == [("a", 2.0), ("state", 3.0), ("twice", 6.0)]


def test_features_are_known_before_the_first_call_when_all_are_declared() -> None:
    assert compose(numbers).declared == (Feature("state", "1", 0.0), Feature("twice"))
    assert compose(numbers, plain).declared is None
    assert declared(compose(compose(numbers))) == (Feature("state", "1", 0.0), Feature("twice"))
    assert declared(plain) is None


def test_a_declared_function_stays_a_function() -> None:
    assert pickle.loads(pickle.dumps(numbers)) is numbers
    assert numbers.__name__ == "numbers"


def test_an_exception_names_its_extractor_and_keeps_its_cause() -> None:
    with pytest.raises(ExtractorError) as caught:
        compose(numbers, compose(plain, fails))(OBSERVATION)
    assert (caught.value.extractor, caught.value.message, caught.value.kind) == ("fails", "no sensor", "LookupError")
    assert isinstance(caught.value.__cause__, LookupError)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ((mistaken,), "extractor mistaken: ValueError: answered c but declares b; make both the same"),
        (
            (plain, again),
            "extractor again: ValueError: answered a, which an earlier extractor answers too; rename it",
        ),
        (
            (listed,),
            "extractor listed: TypeError: answered list; return a dict of features, such as {'height': 1.5}",
        ),
    ],
)
def test_a_wrong_answer_names_its_extractor(parts: tuple, message: str) -> None:
    with pytest.raises(ExtractorError) as caught:
        compose(*parts)(OBSERVATION)
    assert str(caught.value) == message


def test_what_cannot_work_is_refused_at_once() -> None:
    with pytest.raises(ValueError, match="compose needs at least one extractor"):
        compose()
    with pytest.raises(ValueError, match="feature state, twice is declared more than once"):
        compose(numbers, numbers)
    with pytest.raises(ValueError, match="declares at least one feature"):
        extractor()

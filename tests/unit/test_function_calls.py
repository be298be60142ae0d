"""How often a failed call is tried again."""

from __future__ import annotations

import pytest

from fleet.clock import ManualClock
from fleet.errors import CallSite, FunctionError
from fleet.functions.calls import CallError, Failure, attempt, call_with_timeout

SITE = CallSite("crop:map", "agent-1", "row 1, column 2")


class Flaky:
    """Fails the first times, then answers."""

    def __init__(self, failures: int, passing: bool = True) -> None:
        self.left = failures
        self.passing = passing
        self.calls = 0

    def __call__(self) -> str:
        self.calls += 1
        if self.left:
            self.left -= 1
            raise CallError(Failure("is tired", "Fatigue", "legs", passing=self.passing))
        return "done"


def test_a_call_that_fails_twice_succeeds_with_two_retries_and_pauses_that_double() -> None:
    flaky, clock = Flaky(2), ManualClock()
    assert (attempt(flaky, 2, SITE, clock), flaky.calls, clock.now()) == ("done", 3, pytest.approx(0.3))


def test_a_call_that_fails_too_often_is_an_error_with_its_place() -> None:
    flaky, clock = Flaky(9), ManualClock()
    with pytest.raises(FunctionError) as caught:
        attempt(flaky, 8, SITE, clock)
    assert str(caught.value) == "crop:map, extractor legs, agent agent-1, state row 1, column 2: is tired (9 attempts)"
    assert clock.now() == pytest.approx(0.1 + 0.2 + 0.4 + 0.8 + 1.6 + 2 + 2 + 2)


def test_a_failure_that_stays_is_not_tried_again() -> None:
    flaky = Flaky(9, passing=False)
    with pytest.raises(FunctionError) as caught:
        attempt(flaky, 5, SITE, ManualClock())
    assert (flaky.calls, caught.value.message) == (1, "is tired")


def test_an_error_on_the_way_keeps_its_cause() -> None:
    with pytest.raises(CallError) as caught:
        call_with_timeout([1].pop, (7,), 5.0)
    assert isinstance(caught.value.__cause__, IndexError)

"""Calls of functions that may fail: what a failure is, and how often it is tried again."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from traceback import extract_tb
from typing import Any, TypeVar

from fleet.clock import Clock
from fleet.errors import CallSite, FunctionError
from fleet.functions.checks import AnswerError
from fleet.functions.compose import ExtractorError
from fleet.functions.resolve import is_users

T = TypeVar("T")
_FIRST_PAUSE_S = 0.1
_LONGEST_PAUSE_S = 2.0


@dataclass(frozen=True)
class Failure:
    """Why one call failed.

    Args:
        message: What happened and what to mend.
        type: Name of the exception, or of one of the contract's own errors (docs/functions.md).
        extractor: The extractor that failed; "" when none is known.
        traceback: For people; "" when there is none.
        passing: Whether the same call may succeed when it is tried again.
    """

    message: str
    type: str = ""
    extractor: str = ""
    traceback: str = ""
    passing: bool = True


class CallError(Exception):
    """One call of a function failed."""

    def __init__(self, failure: Failure) -> None:
        self.failure = failure
        super().__init__(failure.message)


def attempt(call: Callable[[], T], retries: int, site: CallSite, clock: Clock) -> T:
    """Call, and call again after a failure that may pass, with pauses that double from 0.1 s to 2 s.

    Raises:
        FunctionError: the last failure, once the retries are used up.
    """
    tries = 0
    while True:
        tries += 1
        try:
            return call()
        except (CallError, AnswerError) as error:
            failure = error.failure if isinstance(error, CallError) else Failure(str(error))
            if tries > retries or not failure.passing:
                raise _final(failure, tries, site) from error
        clock.sleep(min(_FIRST_PAUSE_S * 2 ** (tries - 1), _LONGEST_PAUSE_S))


def call_with_timeout(function: Callable[..., T], arguments: tuple[Any, ...], timeout_s: float) -> T:
    """Call a function in a daemon thread and wait for it.

    Python cannot stop a thread: a call that hangs goes on in the background, uses its processor time, and ends with
    the process. A function that holds the interpreter's lock without end (a C extension) cannot be caught here; run it
    as a server of its own.

    Raises:
        CallError: it raised, called exit, or took longer than `timeout_s`.
    """
    answers: list[T] = []
    errors: list[BaseException] = []

    def run() -> None:
        try:
            answers.append(function(*arguments))
        except BaseException as error:  # noqa: BLE001  # SystemExit too: user code must not end the thread silently
            errors.append(error)

    thread = threading.Thread(target=run, name="function call", daemon=True)
    thread.start()
    thread.join(timeout_s)
    if errors:
        raise CallError(failure_of(errors[0])) from errors[0]
    if not answers:
        raise CallError(timed_out(timeout_s))
    return answers[0]


def timed_out(timeout_s: float) -> Failure:
    """The failure of a call that took too long."""
    return Failure(
        f"did not answer within {timeout_s:g} s; make it faster, or raise `timeout` in the FleetSpec", "Timeout"
    )


def failure_of(error: BaseException, traceback: str = "") -> Failure:
    """The failure that an exception of a user function means; names the extractor when the exception knows it."""
    if isinstance(error, ExtractorError):
        where = _where(error.__cause__)
        return Failure(_raised(error.kind, where, error.message), error.kind, error.extractor, traceback)
    if isinstance(error, AnswerError):
        return Failure(str(error), "BadAnswer", "", traceback)
    kind = type(error).__name__
    return Failure(_raised(kind, _where(error), str(error)), kind, "", traceback)


def _raised(kind: str, where: str, message: str) -> str:
    return f"raised {kind}{where}{f': {message}' if message else ''}; correct the function, or what it is given"


def _where(error: BaseException | None) -> str:
    """Deepest line of the user's own code where an exception arose; "" when there is none."""
    trace = error.__traceback__ if error is not None else None
    own = [frame for frame in extract_tb(trace) if is_users(Path(frame.filename))]
    return f" at {Path(own[-1].filename).name} line {own[-1].lineno}" if own else ""


def _final(failure: Failure, tries: int, site: CallSite) -> FunctionError:
    place = CallSite(site.function, site.agent, site.state, failure.extractor or site.extractor)
    error = FunctionError(f"{failure.message}{f' ({tries} attempts)' if tries > 1 else ''}", place)
    if failure.traceback:
        error.add_note(failure.traceback)
    return error

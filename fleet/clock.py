"""Time as an argument: nothing below the roles reads the clock of the machine."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Seconds since the Unix epoch, and waiting."""

    def now(self) -> float:
        """Seconds since the Unix epoch."""

    def sleep(self, seconds: float) -> None:
        """Wait; returns at once for a duration that is not positive."""


class SystemClock:
    """The machine's clock."""

    def now(self) -> float:
        """Seconds since the Unix epoch."""
        return time.time()

    def sleep(self, seconds: float) -> None:
        """Wait; returns at once for a duration that is not positive."""
        if seconds > 0:
            time.sleep(seconds)


class ManualClock:
    """A clock that stands still until it is told to sleep; for tests and for accelerated missions."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        """Seconds since the start that the clock was given, plus everything slept."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Advance by a duration at once."""
        self._now += max(0.0, seconds)

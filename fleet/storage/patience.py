"""Waiting between attempts: longer each time, never all at once, and not for ever."""

from __future__ import annotations

import random
import time
from collections.abc import Callable

from fleet.storage.limits import left_s


class Patience:
    """Waits of one operation.

    Args:
        total_s: Time from the first attempt to the start of the last.
        first_s, most_s: The first wait and the longest; each is twice the one before.
        now, sleep: Seconds of a clock that only goes forward, and waiting.
        chance: A number in [0, 1), so that many that fail together do not try again together.
    """

    def __init__(
        self,
        total_s: float,
        first_s: float = 0.05,
        most_s: float = 5.0,
        *,
        now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
        chance: Callable[[], float] = random.random,
    ) -> None:
        self._now, self._sleep, self._chance = now, sleep, chance
        self._next_s, self._most_s = first_s, most_s
        self._end = now() + total_s

    def wait(self, at_least_s: float = 0.0) -> bool:
        """Wait before another attempt; False, at once, when no time is left for one.

        Args:
            at_least_s: What the server asks for.
        """
        left = self._end - self._now()
        pause = max(self._next_s * (0.5 + 0.5 * self._chance()), at_least_s)
        if left <= 0 or min(pause, left) >= left_s():
            return False
        self._sleep(min(pause, left))
        self._next_s = min(2 * self._next_s, self._most_s)
        return True

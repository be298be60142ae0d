"""Which key is worked on next: one pass of a key at a time, no change lost, failures spaced out. Pure.

Times are seconds on any clock that only goes forward.

Source: kubernetes/client-go, util/workqueue: dirty and processing sets; here with delays and back-off in one place.
"""

from __future__ import annotations

import heapq
import random
from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True)
class Pauses:
    """How passes of one key are spaced.

    Args:
        rest_s: From the end of a pass to the next at least, so that a burst of changes is one pass.
        first_s, longest_s: After failures: full jitter up to first_s, doubled each time, up to longest_s.
    """

    rest_s: float = 0.1
    first_s: float = 0.5
    longest_s: float = 120.0

    def after_failures(self, failures: int) -> float:
        """The longest pause after so many failures in a row."""
        return min(self.longest_s, self.first_s * 2.0 ** min(failures - 1, 60))


class Agenda(Generic[K]):
    """Keys that are due, planned or worked on."""

    def __init__(self, pauses: Pauses, chance: random.Random) -> None:
        self._pauses = pauses
        self._chance = chance
        self._due: OrderedDict[K, None] = OrderedDict()
        self._planned: dict[K, float] = {}
        self._order: list[tuple[float, int, K]] = []
        self._pushed = 0
        self._working: set[K] = set()
        self._changed: set[K] = set()
        self._failures: dict[K, int] = {}
        self._resting: OrderedDict[K, float] = OrderedDict()  # in the order of its times, as every rest is as long

    @property
    def depth(self) -> int:
        """Keys that are due and wait for a worker."""
        return len(self._due)

    def add(self, key: K, now_s: float) -> None:
        """Something of a key changed: a pass begins soon after now, and after the one that is at work."""
        if key in self._working:
            self._changed.add(key)
            return
        rested_s = self._resting.get(key, now_s)
        if rested_s > now_s:
            self._plan(key, rested_s)
        else:
            self._make_due(key)

    def take(self, now_s: float) -> K | None:
        """The key that has been due longest; None when none is. It is at work until `done` or `failed`."""
        self._promote(now_s)
        if not self._due:
            return None
        key, _ = self._due.popitem(last=False)
        self._working.add(key)
        return key

    def done(self, key: K, now_s: float, again_s: float | None = None) -> None:
        """A pass is over.

        Args:
            again_s: When to look again without a change; None for only with one.
        """
        self._failures.pop(key, None)
        wanted = [] if again_s is None else [max(again_s, 0.0)]
        self._end(key, now_s, min(wanted + [0.0] * (key in self._changed), default=None))

    def failed(self, key: K, now_s: float) -> float:
        """A pass failed; returns the seconds until the next."""
        failures = self._failures[key] = self._failures.get(key, 0) + 1
        pause_s = self._chance.uniform(0.0, self._pauses.after_failures(failures))
        self._end(key, now_s, pause_s)
        return max(pause_s, self._pauses.rest_s)

    def discard(self, key: K) -> None:
        """Forget all about a key but a change that came while it is at work."""
        self._due.pop(key, None)
        for memory in (self._planned, self._failures, self._resting):
            memory.pop(key, None)

    def next_s(self) -> float | None:
        """When the next planned key becomes due; None when none is planned."""
        while self._order and self._planned.get(self._order[0][2]) != self._order[0][0]:
            heapq.heappop(self._order)
        return self._order[0][0] if self._order else None

    def _end(self, key: K, now_s: float, again_s: float | None) -> None:
        self._working.remove(key)
        self._changed.discard(key)
        self._resting[key] = now_s + self._pauses.rest_s
        self._resting.move_to_end(key)
        if again_s is not None:
            self._plan(key, now_s + max(again_s, self._pauses.rest_s))

    def _plan(self, key: K, at_s: float) -> None:
        if key in self._due or self._planned.get(key, at_s + 1.0) <= at_s:
            return
        self._planned[key] = at_s
        self._pushed += 1
        heapq.heappush(self._order, (at_s, self._pushed, key))

    def _make_due(self, key: K) -> None:
        self._planned.pop(key, None)
        self._due.setdefault(key)

    def _promote(self, now_s: float) -> None:
        while (at_s := self.next_s()) is not None and at_s <= now_s:
            self._make_due(heapq.heappop(self._order)[2])
        while self._resting and next(iter(self._resting.values())) <= now_s:
            self._resting.popitem(last=False)

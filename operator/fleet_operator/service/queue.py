"""The agenda at work: as many passes at once as there are workers."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Awaitable, Callable, Hashable
from typing import Generic, TypeVar

from fleet_operator.service.agenda import Agenda

K = TypeVar("K", bound=Hashable)


class WorkQueue(Generic[K]):
    """Runs passes.

    Args:
        work: One pass of a key; returns the seconds after which to look again, or None.
        failed: Told when a pass raised: key, error, and the seconds until the next.
        workers: Passes at the same time.
    """

    def __init__(
        self,
        agenda: Agenda[K],
        work: Callable[[K], Awaitable[float | None]],
        failed: Callable[[K, Exception, float], None],
        workers: int,
    ) -> None:
        self._agenda = agenda
        self._work = work
        self._failed = failed
        self._free = asyncio.Semaphore(workers)
        self._news = asyncio.Event()
        self._closing = False
        self._running: dict[asyncio.Task[None], float] = {}

    @property
    def depth(self) -> int:
        """Keys that wait for a worker."""
        return self._agenda.depth

    @property
    def running(self) -> int:
        """Passes at work."""
        return len(self._running)

    @property
    def longest_s(self) -> float:
        """How long the oldest pass has been at work; 0 when none is."""
        return time.monotonic() - min(self._running.values()) if self._running else 0.0

    def add(self, key: K) -> None:
        """Something of a key changed."""
        self._agenda.add(key, time.monotonic())
        self._news.set()

    def discard(self, key: K) -> None:
        """A key is of no interest any more."""
        self._agenda.discard(key)

    async def run(self) -> None:
        """Hand keys to workers until closed."""
        while not self._closing:
            await self._free.acquire()
            key = await self._next()
            if key is None:
                self._free.release()
                return
            task = asyncio.create_task(self._pass(key), name=f"pass of {key}")
            self._running[task] = time.monotonic()
            task.add_done_callback(self._running.pop)

    async def close(self, grace_s: float) -> bool:
        """Begin no more passes, let those at work end, and break off what has not ended by then.

        Returns:
            Whether all ended by themselves.
        """
        self._closing = True
        self._news.set()
        running = list(self._running)
        if not running:
            return True
        _, late = await asyncio.wait(running, timeout=grace_s)
        for task in late:
            task.cancel()
        if late:
            await asyncio.wait(late, timeout=1.0)
        return not late

    async def _next(self) -> K | None:
        while not self._closing:
            key = self._agenda.take(time.monotonic())
            if key is not None:
                return key
            self._news.clear()
            planned_s = self._agenda.next_s()
            wait_s = None if planned_s is None else max(0.0, planned_s - time.monotonic())
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), wait_s)
        return None

    async def _pass(self, key: K) -> None:
        try:
            again_s = await self._work(key)
        except Exception as error:  # noqa: BLE001 - whatever is wrong with one fleet must not stop the others
            self._failed(key, error, self._agenda.failed(key, time.monotonic()))
        except asyncio.CancelledError:
            self._agenda.failed(key, time.monotonic())
            raise
        else:
            self._agenda.done(key, time.monotonic(), again_s)
        finally:
            self._free.release()
            self._news.set()

"""Jobs side by side in worker processes, with the same results for any number of them.

A job is a module-level function of what all jobs share and of one item. It must depend on these alone: a worker that
dies takes its jobs with it, and they are done again.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait
from typing import Any, Generic, TypeVar

import scipy.linalg  # noqa: F401 - its BLAS must be there when threads are limited, not come with the first job
from threadpoolctl import threadpool_limits

from fleet.errors import TrainingError

Shared = TypeVar("Shared")
Item = TypeVar("Item")
Result = TypeVar("Result")

_TRIES = 2
_shared: Any = None


class Workers(Generic[Shared]):
    """Worker processes that hold a copy of what their jobs share; a context manager.

    Args:
        count: How many; 1 works in this process.
        shared: Given to every job. Must be picklable when there is more than one worker.
    """

    def __init__(self, count: int, shared: Shared) -> None:
        self._count = count
        self._shared = shared
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> Workers[Shared]:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def map(self, job: Callable[[Shared, Item], Result], items: Sequence[Item]) -> list[Result]:
        """Results of the jobs, in the order of the items.

        Raises:
            TrainingError: workers died twice in a row.
            Exception: what a job raised.
        """
        if self._count == 1 or not items:
            with threadpool_limits(1):
                return [job(self._shared, item) for item in items]
        for _ in range(_TRIES):
            try:
                return list(self._open().map(_work, [(job, item) for item in items]))
            except BrokenProcessPool:
                self._close()
            except BaseException:
                self._close()
                raise
        raise TrainingError(
            f"a worker process died {_TRIES} times, most likely for want of memory; give the trainer more, "
            "or fewer worker processes"
        )

    def _open(self) -> ProcessPoolExecutor:
        if self._pool is None:
            # Spawned, not forked: a fork copies locks that threads of this process may hold.
            self._pool = ProcessPoolExecutor(
                self._count, multiprocessing.get_context("spawn"), initializer=_prepare, initargs=(self._shared,)
            )
        return self._pool

    def _close(self) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None


def _prepare(shared: Any) -> None:
    """Once in each worker. One thread for each: they share the cores, and sums do not depend on how many there are."""
    global _shared  # noqa: PLW0603 - the one thing that a pool's initialiser can leave for its jobs
    _shared = shared
    threadpool_limits(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to all; the parent ends its workers
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A pool's workers would wait for work for ever when their parent is killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _work(task: tuple[Callable[[Any, Any], Any], Any]) -> Any:
    job, item = task
    return job(_shared, item)

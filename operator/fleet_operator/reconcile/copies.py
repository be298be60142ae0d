"""Whether a storage keeps as many copies as it is asked for: looked at when a fleet's storage is first opened.

A storage with fewer acknowledges what one broken disk can lose. That is told, and stops no fleet.
"""

from __future__ import annotations

import asyncio
import logging
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from fleet.errors import StorageError
from fleet.storage.port import Storage

log = logging.getLogger(__name__)

FEWER_COPIES = "FewerCopies"
EVERY_S = 3600.0
"""How old an answer may be: a DataNode comes and goes."""


@runtime_checkable
class Copied(Protocol):
    """A storage that keeps copies."""

    def check_copies(self) -> None:
        """Write a small file, to see that it does. Raises StorageError when it keeps fewer than it is asked for."""


@dataclass
class _Answer:
    asked_s: float
    is_there: bool = False
    complaint: str = ""


@dataclass
class Copies:
    """What storages have answered, by address; the first fleet asks, others of the same storage do not wait for it."""

    _answers: dict[str, _Answer] = field(default_factory=dict)

    async def complaint(self, storage: Storage, now_s: float) -> str | None:
        """What is wrong with the copies of a storage; "" when nothing is, None when that is not known yet.

        Args:
            now_s: Seconds since the Unix epoch.
        """
        if not isinstance(storage, Copied):
            return ""
        answer = self._answers.get(storage.uri)
        if answer is None or now_s - answer.asked_s >= EVERY_S:
            answer = self._answers[storage.uri] = _Answer(now_s)
            try:
                answer.complaint = await asyncio.to_thread(_complaint, storage)
                answer.is_there = True
            finally:
                if not answer.is_there:
                    del self._answers[storage.uri]
        return answer.complaint if answer.is_there else None


def _complaint(storage: Copied) -> str:
    try:
        storage.check_copies()
    except StorageError as error:
        if type(error) is StorageError:  # its kinds say that it is away or full, which the pass itself meets and tells
            return str(error)
        log.warning("it is not known how many copies the storage keeps: %s", error)
    return ""

"""What one call to a storage may take of the process that makes it."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

_ENDS_S: ContextVar[float] = ContextVar("fleet_storage_ends_s", default=math.inf)


@dataclass(frozen=True)
class Limits:
    """What one call may take.

    Args:
        object_bytes: The largest object that is read.
        call_s: The longest time for one request with all of its data, however slowly it arrives.
    """

    object_bytes: int = 4 << 30
    call_s: float = 900.0


def too_large(size_bytes: int, most_bytes: int) -> str:
    """What is said of an object that is not read."""
    size = f"it has {size_bytes >> 20} MiB" if size_bytes > most_bytes else "it has no end"
    return f"{size}, and this process reads objects of at most {most_bytes >> 20} MiB"


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Have all calls to storages in here end in this time, those of threads too that take the context over."""
    token = _ENDS_S.set(min(_ENDS_S.get(), time.monotonic() + seconds))
    try:
        yield
    finally:
        _ENDS_S.reset(token)


def left_s() -> float:
    """Seconds that calls to storages may go on here; not positive when they may not."""
    return _ENDS_S.get() - time.monotonic()

"""Waiting until something is so."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

from tests.testbed.errors import NotReady

T = TypeVar("T")


def wait_for(what: str, look: Callable[[], T | None], timeout_s: float = 60.0, every_s: float = 0.05) -> T:
    """What `look` finds as soon as it finds something (not None, not False).

    Raises:
        NotReady: it found nothing for `timeout_s` seconds.
    """
    end = time.monotonic() + timeout_s
    while True:
        found = look()
        if found is not None and found is not False:
            return found
        if time.monotonic() > end:
            raise NotReady(f"{what}: not within {timeout_s:g} s")
        time.sleep(every_s)

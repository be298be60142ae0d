"""What a benchmark says, and how time is taken."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Result:
    """One figure, and the figure of a peer from the same run.

    Args:
        name: What was measured; unique over all benchmarks.
        value: The figure.
        unit: Unit of both figures.
        peer: What it is held against; "" for nothing.
        peer_value: The peer's figure, from the same run on the same machine.
        ratio: value / peer_value.
        command: Gives the figure again.
    """

    name: str
    value: float
    unit: str
    peer: str = ""
    peer_value: float | None = None
    ratio: float | None = None
    command: str = ""

    @staticmethod
    def against(name: str, value: float, unit: str, peer: tuple[str, float], command: str) -> Result:
        """A figure beside a peer's: its name and its figure."""
        return Result(name, value, unit, peer[0], peer[1], value / peer[1], command)


def seconds(action: Callable[[], object], repeats: int = 5, warm_up: int = 1) -> float:
    """Time that an action takes: the shortest of several, after runs that do not count.

    The shortest is the one that the rest of the machine disturbed least.
    """
    for _ in range(warm_up):
        action()
    gc.collect()
    taken = []
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        taken.append(time.perf_counter() - start)
    return min(taken)

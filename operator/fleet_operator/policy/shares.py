"""How the aggregators divide the CPU and memory that they have together.

Source: paper, section "Priority-based Scheduling": CPU_i = CPU_t / sum(P_j) * P_i, and memory alike. A share that no
machine could hold is cut to the largest machine, and what that frees is divided among the others (water-filling).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

SMALLEST_REQUEST_CORES = 0.05
SMALLEST_REQUEST_BYTES = 64 * 2**20
REQUESTED_SHARE = 0.1
"""Share of the limit that is requested: small, so that the bin packing stays feasible."""


@dataclass(frozen=True)
class Capacity:
    """CPU and memory of one machine, or of all together."""

    cores: float
    memory_bytes: float


@dataclass(frozen=True)
class Share:
    """What an aggregator may use at most, and what the scheduler keeps free for it."""

    limit: Capacity
    request: Capacity


def shares(levels: Mapping[str, int], total: Capacity, largest_node: Capacity) -> dict[str, Share]:
    """CPU and memory of each aggregator that is scheduled.

    Args:
        levels: Level 0..9 of each aggregator; those of level 0 are not scheduled.
        total: What all aggregators share.
        largest_node: No aggregator gets more than the largest machine that it may run on.
    Returns:
        A share for each aggregator of level 1 or above; their limits sum up to at most the total.
    Raises:
        ValueError: a level is outside of 0..9, or a capacity is negative or not finite.
    """
    wrong = {key: level for key, level in levels.items() if not 0 <= level <= 9}
    if wrong:
        raise ValueError(f"levels are 0..9, not {wrong}")
    cores = water_fill(levels, total.cores, largest_node.cores)
    memory = water_fill(levels, total.memory_bytes, largest_node.memory_bytes)
    return {key: _share(Capacity(cores[key], math.floor(memory[key]))) for key in cores}


def shares_of_the_rest(
    levels: Mapping[str, int], finished: Collection[str], total: Capacity, largest_node: Capacity
) -> dict[str, Share]:
    """CPU and memory of the aggregators that are not finished, when what the others had is divided among them.

    Returns:
        As `shares`; nobody gets less than before, as fewer divide the same.
    Raises:
        ValueError: as `shares`.
    """
    return shares({key: level for key, level in levels.items() if key not in finished}, total, largest_node)


def water_fill(levels: Mapping[str, int], total: float, cap: float) -> dict[str, float]:
    """Divide a total in proportion to levels, none above a cap; what is cut off goes to those below the cap.

    Returns:
        The amount of each key of a level above 0. Their sum is the total, or every one has the cap.
    Raises:
        ValueError: the total or the cap is negative or not finite.
    """
    if not (math.isfinite(total) and math.isfinite(cap) and total >= 0 and cap >= 0):
        raise ValueError(f"total {total} and cap {cap} must be finite and not negative")
    amounts: dict[str, float] = {}
    left = total
    open_levels = {key: level for key, level in levels.items() if level > 0}
    for key in sorted(open_levels, key=lambda key: (-open_levels[key], key)):  # the highest reach the cap first
        weight = sum(level for other, level in open_levels.items() if other not in amounts)
        amounts[key] = min(cap, left * open_levels[key] / weight)
        left = max(0.0, left - amounts[key])
    return {key: amounts[key] for key in open_levels}


def _share(limit: Capacity) -> Share:
    request = Capacity(
        min(limit.cores, max(SMALLEST_REQUEST_CORES, limit.cores * REQUESTED_SHARE)),
        min(limit.memory_bytes, max(SMALLEST_REQUEST_BYTES, math.floor(limit.memory_bytes * REQUESTED_SHARE))),
    )
    return Share(limit, request)

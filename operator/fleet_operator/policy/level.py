"""From the usefulness of a model to the scheduling level of its aggregator, and to Kubernetes' priority.

Source: paper, section "Priority-based Scheduling": P_i = round(10 U_i) * 100,000,000.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from fleet.spec.platform import UsefulnessScale
from fleet_operator.resources.roles import REAL_TIME_LEVEL

HIGHEST_LEVEL = 9
UNSEEN_LEVEL = 1
"""A model that has never been evaluated is trained at least once."""
PRIORITY_STEP = 100_000_000


def level(usefulness: float | None, scale: UsefulnessScale, largest: float) -> int:
    """Map a model's usefulness to its scheduling level.

    Args:
        usefulness: Mean weight that the agents give the model, in [0, 1]; None when it has never been evaluated.
        scale: Absolute is the paper's; Relative divides by the largest usefulness.
        largest: The largest usefulness of all models of the fleet, in [0, 1]; 0 when there is none.
    Returns:
        Level 0..9; halves round up. Level 10 is kept for sensors.
    Raises:
        ValueError: usefulness or largest is outside of [0, 1] or not finite, or usefulness is above largest.
    Source: paper, section "Priority-based Scheduling", P_i.
    """
    _check("largest", largest)
    if usefulness is None:
        return UNSEEN_LEVEL
    _check("usefulness", usefulness)
    if usefulness > largest:
        raise ValueError(f"usefulness {usefulness} is above the largest, {largest}")
    match scale:
        case UsefulnessScale.ABSOLUTE:
            share = usefulness
        case UsefulnessScale.RELATIVE:
            share = usefulness / largest if largest > 0 else 0.0
    return min(HIGHEST_LEVEL, math.floor(10 * share + 0.5))


def levels(usefulness: Mapping[str, float | None], scale: UsefulnessScale) -> dict[str, int]:
    """The level of each model of a fleet; see `level`. Raises ValueError as it does."""
    largest = max((value for value in usefulness.values() if value is not None), default=0.0)
    return {model: level(value, scale, largest) for model, value in usefulness.items()}


def priority_value(level: int) -> int:
    """The value of a level's PriorityClass.

    Raises:
        ValueError: the level is outside of 0..10.
    Source: paper, section "Priority-based Scheduling", P_i.
    """
    if not 0 <= level <= REAL_TIME_LEVEL:
        raise ValueError(f"level {level} is outside of 0..{REAL_TIME_LEVEL}")
    return level * PRIORITY_STEP


def _check(name: str, value: float) -> None:
    if not 0 <= value <= 1:  # not true for NaN either
        raise ValueError(f"{name} {value} is outside of [0, 1]")

"""When the map is good enough: HA as a calibrated stop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]
MARGIN = 0.01
"""What is claimed above the goal however much was captured."""
CAUTIONS = np.arange(0.0, 3.01, 0.05)
"""What is tried when a rule is learned."""


@dataclass(frozen=True)
class Claim:
    """What an agent claimed of the map at one moment.

    Args:
        time_s: Mission time.
        captured: Cells captured by all, as far as the agent has heard.
        predictions: How many predictions the claim was calibrated on.
        accuracy: Expected accuracy.
    """

    time_s: float
    captured: int
    predictions: int
    accuracy: float


def usual_caution(goal: float) -> float:
    """The caution for a goal for those who have no context to learn it from.

    It falls with the goal: early claims rest on few predictions, and a map that is to be 90 % right takes many. The
    line is about what four fields taught for 70 and 80 % (`python -m bench.scouting.stops`).
    """
    return float(np.clip(5.0 - 5.0 * goal, 0.5, CAUTIONS[-1]))


@dataclass(frozen=True)
class StopRule:
    """The mission ends when its expected accuracy, less what it may be off by, reaches the goal.

    Args:
        goal: Accuracy to reach, 0..1.
        caution: How much the claim may be off by after one prediction; it falls with the square root of their number.
    """

    goal: float
    caution: float = 1.0

    def is_met(self, claimed: float, predictions: int) -> bool:
        """Whether the mission ends.

        Args:
            claimed: Expected accuracy.
            predictions: How many predictions it was calibrated on.
        """
        return predictions > 0 and claimed >= self.needed(predictions)

    def needed(self, predictions: int) -> float:
        """Expected accuracy with which the mission ends; above 1 when it cannot end yet.

        Args:
            predictions: How many the claim was calibrated on, at least 1.
        """
        return float(self.goal + MARGIN + self.caution / predictions**0.5)


@dataclass(frozen=True, eq=False)
class Claims:
    """What a simulated mission claimed along its way, and how good its map was.

    Args:
        claimed, truth: Expected and true accuracy, float64 [K].
        predictions: On how many predictions each claim was calibrated, int64 [K].
        energy_j: Energy of a mission that lands then, float64 [K].
    """

    claimed: Values
    truth: Values
    predictions: NDArray[np.int64]
    energy_j: Values

    def stop(self, rule: StopRule) -> int | None:
        """Index at which the rule ends the mission; None when it never does."""
        met = np.array([rule.is_met(*pair) for pair in zip(self.claimed, self.predictions.tolist(), strict=True)])
        return int(met.argmax()) if met.any() else None


def learned(missions: Sequence[Claims], goal: float, confidence: float) -> StopRule:
    """The least cautious rule with which simulated missions over contexts meet a goal often enough.

    Args:
        missions: Flown until the whole field is captured, or nearly.
        confidence: Share of the missions that must have met the goal when they end.

    Returns:
        The rule; that of the greatest caution when none is confident enough, and the default without missions.
    """
    if not missions:
        return StopRule(goal)
    for caution in CAUTIONS:
        rule = StopRule(goal, float(caution))
        if np.mean([_succeeds(mission, rule) for mission in missions]) >= confidence:
            return rule
    return StopRule(goal, float(CAUTIONS[-1]))


def _succeeds(mission: Claims, rule: StopRule) -> bool:
    at = mission.stop(rule)
    return bool(mission.truth[-1 if at is None else at] >= rule.goal)

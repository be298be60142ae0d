"""Conditions as Kubernetes' conventions have them: one of each type, and a time that moves with the status only.

Source: Kubernetes, "API conventions", typical status properties.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from fleet.spec.base import Condition

LONGEST_MESSAGE = 1024
_LONGEST_REASON = 128
_NOT_A_REASON = re.compile(r"^[^A-Za-z]+|[^A-Za-z0-9]")


class FleetCondition(StrEnum):
    """Types of the conditions of a FleetSpec, in the order in which they are shown."""

    READY = "Ready"
    RECONCILING = "Reconciling"
    COMPILED = "Compiled"
    SHAPED = "Shaped"
    TRAINED = "Trained"
    FLYING = "Flying"
    GOALS_MET = "GoalsMet"
    DEGRADED = "Degraded"
    STALLED = "Stalled"


class MissionCondition(StrEnum):
    """Types of the conditions of a Mission, in the order in which they are shown."""

    READY = "Ready"
    RECONCILING = "Reconciling"
    FLYING = "Flying"
    COMPLETE = "Complete"
    GOALS_MET = "GoalsMet"
    DEGRADED = "Degraded"
    STALLED = "Stalled"


class Truth(StrEnum):
    """Status of a condition."""

    TRUE = "True"
    FALSE = "False"
    UNKNOWN = "Unknown"


@dataclass(frozen=True)
class Finding:
    """What is said of one type of condition.

    Args:
        reason: One CamelCase word; what Kubernetes would not take is left out of it.
        message: For people; cut when it is too long.
    """

    truth: Truth
    reason: str
    message: str = ""

    @property
    def is_true(self) -> bool:
        """Whether the status is True."""
        return self.truth is Truth.TRUE


def yes(reason: str, message: str = "") -> Finding:
    """A condition that is True."""
    return Finding(Truth.TRUE, reason, message)


def no(reason: str, message: str = "") -> Finding:
    """A condition that is False."""
    return Finding(Truth.FALSE, reason, message)


def unknown(reason: str, message: str = "") -> Finding:
    """A condition of which nothing is known."""
    return Finding(Truth.UNKNOWN, reason, message)


def finding_of(condition: Condition) -> Finding:
    """What a condition says."""
    return Finding(Truth(condition.status), condition.reason, condition.message)


def by_type(conditions: Sequence[Condition]) -> dict[str, Condition]:
    """Conditions by their type."""
    return {condition.type: condition for condition in conditions}


def conditions_of(
    findings: Mapping[str, Finding], before: Sequence[Condition], generation: int, now: str
) -> tuple[Condition, ...]:
    """Conditions in the order of the findings; the time is `now` only where the status is new or another than before.

    Args:
        findings: By type of condition.
        generation: The metadata.generation that they speak of.
        now: RFC 3339.
    """
    old = by_type(before)
    return tuple(
        Condition(
            type=kind,
            status=finding.truth.value,
            reason=_word(finding.reason),
            message=shortened(finding.message),
            observed_generation=generation,
            last_transition_time=old[kind].last_transition_time
            if kind in old and old[kind].status == finding.truth.value and old[kind].last_transition_time
            else now,
        )
        for kind, finding in findings.items()
    )


def shortened(message: str) -> str:
    """A message of at most `LONGEST_MESSAGE` characters."""
    return message if len(message) <= LONGEST_MESSAGE else message[: LONGEST_MESSAGE - 3] + "..."


def _word(reason: str) -> str:
    return _NOT_A_REASON.sub("", reason)[:_LONGEST_REASON] or "Unknown"

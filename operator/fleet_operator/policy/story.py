"""Which changes of a fleet's status are worth an Event, and what it says.

`kubectl describe fleetspec` shows them in their order, so they are what a user reads first: one for each step that
was reached, and one for each thing that went wrong or is right again.
"""

from __future__ import annotations

from typing import Literal

from fleet.spec.resources import FleetStatus
from fleet_operator.resources.conditions import Finding, FleetCondition, Truth, by_type, finding_of, shortened, unknown

Told = tuple[Literal["Normal", "Warning"], str, str]
"""Type, reason and message of an Event."""

_REACHED = (FleetCondition.COMPILED, FleetCondition.SHAPED, FleetCondition.TRAINED)
_PHASES = {"Training", "Retraining", "Weighing", "Waiting", "Suspended", "Done"}
"""Phases that are told when they begin; the others have an event that says more."""


def story(before: FleetStatus | None, after: FleetStatus) -> tuple[Told, ...]:
    """The events that a change of status is worth, in the order in which things happened."""
    old = before or FleetStatus()
    told = (*_reached(old, after), *_ended(old, after), *_begun(old, after), *_wrong(old, after))
    return (*told, *_stalled(old, after, told))


def _reached(old: FleetStatus, new: FleetStatus) -> list[Told]:
    """Compiled, shaped, trained; a refusal whenever it says another thing."""
    told: list[Told] = []
    for kind in _REACHED:
        was, now = _finding(old, kind), _finding(new, kind)
        if now.is_true and not was.is_true:
            told.append(("Normal", kind.value, now.message))
    refusal, was = _finding(new, FleetCondition.COMPILED), _finding(old, FleetCondition.COMPILED)
    if refusal.truth is Truth.FALSE and _says(refusal) != _says(was):
        told.append(("Warning", refusal.reason, refusal.message))
    return told


def _ended(old: FleetStatus, new: FleetStatus) -> list[Told]:
    """The goals of a mission that has ended."""
    goals, was = _finding(new, FleetCondition.GOALS_MET), _finding(old, FleetCondition.GOALS_MET)
    if goals.truth is Truth.UNKNOWN or _says(goals) == _says(was):
        return []
    return [("Normal" if goals.is_true else "Warning", goals.reason, goals.message)]


def _begun(old: FleetStatus, new: FleetStatus) -> list[Told]:
    """The mission that was ordered, and the phase that began."""
    told: list[Told] = []
    if new.mission > old.mission:
        told.append(("Normal", "MissionOrdered", f"mission {new.mission} is ordered"))
    if new.phase != old.phase and new.phase in _PHASES:
        text = _finding(new, FleetCondition.TRAINED if new.phase == "Training" else FleetCondition.READY).message
        told.append(("Normal", new.phase, text))
    if old.phase == "Suspended" and new.phase not in (old.phase, "Done"):
        told.append(("Normal", "Resumed", "spec.suspend is false again"))
    return told


def _wrong(old: FleetStatus, new: FleetStatus) -> list[Told]:
    """Trouble when it says another thing, and its end."""
    told: list[Told] = []
    trouble, was = _finding(new, FleetCondition.DEGRADED), _finding(old, FleetCondition.DEGRADED)
    if trouble.is_true and _says(trouble) != _says(was):
        told.append(("Warning", trouble.reason, trouble.message))
    elif was.is_true and not trouble.is_true:
        told.append(("Normal", "Recovered", shortened(f"no longer: {was.message}")))
    return told


def _stalled(old: FleetStatus, new: FleetStatus, told: tuple[Told, ...]) -> list[Told]:
    """That nothing goes on any more, unless the same words are told just now."""
    stalled, was = _finding(new, FleetCondition.STALLED), _finding(old, FleetCondition.STALLED)
    if not stalled.is_true or _says(stalled) == _says(was) or _says(stalled) in [each[1:] for each in told]:
        return []
    return [("Warning", FleetCondition.STALLED.value, stalled.message)]


def _says(finding: Finding) -> tuple[str, str]:
    return finding.reason, finding.message


def _finding(status: FleetStatus, kind: FleetCondition) -> Finding:
    condition = by_type(status.conditions).get(kind.value)
    return unknown("") if condition is None else finding_of(condition)

"""What a fleet's status says: one phase for people, conditions for programs.

How others read the conditions (kstatus; Helm's `--wait` and Argo CD read them in the same way), in this order:

1. An object that is being deleted is Terminating.
2. `status.observedGeneration` is not `metadata.generation`: InProgress; the status speaks of an older spec.
3. Reconciling is True: InProgress. Stalled is True: Failed. Never are both True here.
4. Ready is False or Unknown: InProgress. Ready is True: Current.

So Ready=False alone never means failure, and Stalled=True means that nothing goes on without the user.

Source: sigs.k8s.io/cli-utils, pkg/kstatus; Kubernetes, "API conventions", typical status properties.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from fleet.missions.documents import MissionEvaluation
from fleet.spec.resources import FleetStatus, MissionStatus
from fleet_operator.policy.lifecycle import (
    Failed,
    Fly,
    Order,
    Prepare,
    Progress,
    Retrain,
    Step,
    Train,
    Wait,
    Weigh,
    phase,
)
from fleet_operator.policy.sentences import evaluation_text, goals_count, share, step_text
from fleet_operator.policy.story import story
from fleet_operator.policy.times import rfc3339
from fleet_operator.resources.conditions import (
    Finding,
    FleetCondition,
    by_type,
    conditions_of,
    finding_of,
    no,
    unknown,
    yes,
)

__all__ = ["PENDING", "REFUSED", "Situation", "Trouble", "fleet_status", "status_manifest", "status_of", "story"]

Manifest = dict[str, Any]
REFUSED, PENDING = "Refused", "Pending"
"""Phases of a fleet whose FleetSpec cannot be compiled, and of one for which no step was ever decided."""
_NOT_OBSERVED = unknown("NotObserved", "what the fleet has reached could not be read yet")
_SHOWN_TROUBLES = 3
_WORK = Prepare | Train | Order | Fly | Retrain | Weigh
"""Steps at which something is under way, which a FleetSpec that is refused meanwhile does not stop."""


@dataclass(frozen=True)
class Trouble:
    """Something that is not as it should be.

    Args:
        reason: One CamelCase word that a program can match.
        message: What it is, and what to do about it.
        lasting: It ends only when somebody does something. A refusal that lasts stops a fleet when nothing is under way
            any more; any other trouble that lasts must be one that all else waits for.
    """

    reason: str
    message: str
    lasting: bool = False


@dataclass(frozen=True)
class Situation:
    """All that a fleet's status is made of.

    Args:
        generation: metadata.generation of the FleetSpec.
        step: What the fleet does next; None when that was not decided: then what was said before stays.
        refusal: Why the FleetSpec cannot be compiled; None when it can.
        progress, shaped, last: What the fleet has reached, whether the reward is in storage, and the evaluation of the
            last mission that ended; these count only with a step.
        troubles: What is not as it should be, the worst first.
        storage_uri: Where the data is.
        now: The time, RFC 3339.
        missions: How many missions the FleetSpec asks for.
    """

    generation: int
    step: Step | None
    refusal: Trouble | None
    progress: Progress
    shaped: bool
    last: MissionEvaluation | None
    troubles: tuple[Trouble, ...]
    storage_uri: str
    now: str
    missions: int = 0


Findings = dict[FleetCondition, Finding]


def fleet_status(situation: Situation, before: FleetStatus | None) -> FleetStatus:
    """The status of a fleet; what could not be observed stays as it was before."""
    old = before or FleetStatus()
    step = situation.step
    status = old if step is None else _columns(situation, step)
    findings = _carried(situation, old) if step is None else _reached(situation, step)
    if situation.refusal is not None:
        findings[FleetCondition.COMPILED] = no(situation.refusal.reason, situation.refusal.message)
    findings[FleetCondition.DEGRADED] = _degraded(situation)
    findings |= _verdict(situation, findings)
    ordered = {kind.value: findings[kind] for kind in FleetCondition}
    return status.model_copy(
        update={
            "observed_generation": situation.generation,
            "phase": _phase(situation, old),
            "storage_uri": situation.storage_uri or old.storage_uri,
            "conditions": conditions_of(ordered, old.conditions, situation.generation, situation.now),
        }
    )


def status_manifest(status: FleetStatus | MissionStatus) -> Manifest:
    """`status` as Kubernetes has it, without what is empty."""
    document: Manifest = status.model_dump(mode="json", by_alias=True)
    return {name: value for name, value in document.items() if value not in ("", [], {}, None)}


def status_of(manifest: Mapping[str, Any]) -> FleetStatus | None:
    """The status that a FleetSpec in the cluster has; None when it has none, or one of another version."""
    try:
        return FleetStatus.model_validate(manifest["status"]) if manifest.get("status") else None
    except ValidationError:
        return None


def _columns(situation: Situation, step: Step) -> FleetStatus:
    missions, last = situation.progress.missions, situation.last
    flown = sum(mission.evaluated for mission in missions)
    return FleetStatus(
        mission=len(missions),
        missions_flown=flown,
        missions=f"{flown}/{max(flown, situation.missions)}",
        coverage=share(last, "coverage") if last else "",
        accuracy=share(last, "accuracy") if last else "",
        goals=goals_count(last) if last else "",
        next_mission=rfc3339(step.until_s) if isinstance(step, Wait) else "",
    )


def _phase(situation: Situation, old: FleetStatus) -> str:
    if situation.refusal is not None:
        return REFUSED
    if situation.step is not None:
        return phase(situation.step)
    return old.phase if old.phase not in ("", REFUSED) else PENDING


def _reached(situation: Situation, step: Step) -> Findings:
    """What is known of a fleet for which a step was decided."""
    progress, word = situation.progress, phase(step)
    text = step_text(step, progress, situation.shaped)
    flies = isinstance(step, Order | Fly)
    last = situation.last
    goals = unknown("NotEvaluated", "no mission has ended yet")
    if last is not None:
        goals = (yes if last.goals_met else no)("GoalsMet" if last.goals_met else "GoalsMissed", evaluation_text(last))
    shaped = situation.shaped or progress.trained
    can_fly = progress.trained and not isinstance(step, Prepare | Train | Failed)
    return {
        FleetCondition.COMPILED: yes("Compiled", "the FleetSpec is valid, and all that it names is there"),
        FleetCondition.SHAPED: yes("Shaped", "the reward is in storage") if shaped else no(word, text),
        FleetCondition.TRAINED: yes("Trained", "the first model is in storage") if progress.trained else no(word, text),
        FleetCondition.FLYING: yes(word, text) if flies else no(word),
        FleetCondition.GOALS_MET: goals,
        FleetCondition.READY: yes(word, text) if can_fly else no(word, text),
        FleetCondition.STALLED: yes(word, text) if isinstance(step, Failed) else no("GoesOn"),
    }


def _carried(situation: Situation, old: FleetStatus) -> Findings:
    """What was said before; of another generation, that is no word on whether it compiles and is ready."""
    known = {FleetCondition(kind): finding_of(each) for kind, each in by_type(old.conditions).items()}
    findings = {kind: known.get(kind, _NOT_OBSERVED) for kind in FleetCondition}
    of_the_spec = (FleetCondition.COMPILED, FleetCondition.READY, FleetCondition.STALLED)
    is_refused_no_more = situation.refusal is None and old.phase == REFUSED
    if old.observed_generation != situation.generation or is_refused_no_more:
        findings |= dict.fromkeys(of_the_spec, _NOT_OBSERVED)
    return findings


def _degraded(situation: Situation) -> Finding:
    troubles = situation.troubles
    if not troubles:
        return no("NoTrouble")
    told = "; ".join(trouble.message for trouble in troubles[:_SHOWN_TROUBLES])
    left = len(troubles) - _SHOWN_TROUBLES
    return yes(troubles[0].reason, f"{told}; and {left} more" if left > 0 else told)


def _verdict(situation: Situation, findings: Findings) -> Findings:
    """Ready, Reconciling and Stalled, which must fit together: see the rules at the top."""
    stalled, ready = findings[FleetCondition.STALLED], findings[FleetCondition.READY]
    refused = situation.refusal
    under_way = isinstance(situation.step, _WORK)
    blockers = [trouble for trouble in situation.troubles if trouble.lasting]
    if refused is not None and refused.lasting and not under_way:
        blockers.insert(0, refused)
    if blockers:
        stalled = yes(blockers[0].reason, blockers[0].message)
    elif refused is not None and situation.step is None:
        stalled = no("GoesOn")
    if stalled.is_true:
        ready = no(stalled.reason, stalled.message)
    elif refused is not None:
        ready = no(refused.reason, refused.message)
    works = not (ready.is_true or stalled.is_true or refused is not None)
    return {
        FleetCondition.READY: ready,
        FleetCondition.RECONCILING: yes(ready.reason, ready.message) if works else no(ready.reason),
        FleetCondition.STALLED: stalled,
    }

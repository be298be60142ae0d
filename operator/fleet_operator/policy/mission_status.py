"""What the status of a Mission says; conditions are read as those of a FleetSpec are, see `policy.status`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fleet.missions.documents import MissionEvaluation
from fleet.spec.resources import AgentProgress, MissionStatus
from fleet_operator.policy.lifecycle import MissionProgress
from fleet_operator.policy.sentences import counted, evaluation_text, goals_count, retraining_text, share
from fleet_operator.resources.conditions import Finding, MissionCondition, conditions_of, no, shortened, unknown, yes

PENDING, FLYING, RETRAINING, SUCCEEDED, FAILED = "Pending", "Flying", "Retraining", "Succeeded", "Failed"
LANDED = "Landed"


@dataclass(frozen=True)
class MissionSituation:
    """All that a Mission's status is made of.

    Args:
        agents: Names of the fleet's agents.
        progress: What the mission has reached.
        records_uri: Where its records are.
        now: The time, RFC 3339.
        running: Agents whose workflow runs.
        failures: Why agents failed, by name.
        steps: States visited, by agent, as far as that is known before the evaluation.
        evaluation: Its evaluation, when it was evaluated.
        broken: Why it can never be evaluated; "" as long as it can.
        generation: metadata.generation of the Mission.
    """

    agents: tuple[str, ...]
    progress: MissionProgress
    records_uri: str
    now: str
    running: frozenset[str] = frozenset()
    failures: Mapping[str, str] = field(default_factory=dict)
    steps: Mapping[str, int] = field(default_factory=dict)
    evaluation: MissionEvaluation | None = None
    broken: str = ""
    generation: int = 1


def mission_status(situation: MissionSituation, before: MissionStatus | None) -> MissionStatus:
    """The status of a Mission."""
    evaluation = situation.evaluation
    phase = _phase(situation)
    findings = {kind.value: finding for kind, finding in _findings(situation, phase).items()}
    conditions = before.conditions if before is not None else ()
    landed = situation.progress.landed.intersection(situation.agents)
    return MissionStatus(
        observed_generation=situation.generation,
        phase=phase,
        agents=tuple(_agent(situation, agent) for agent in situation.agents),
        landed=f"{len(landed)}/{len(situation.agents)}",
        evaluation=dict(evaluation.metrics) if evaluation else {},
        coverage=share(evaluation, "coverage") if evaluation else "",
        accuracy=share(evaluation, "accuracy") if evaluation else "",
        goals=goals_count(evaluation) if evaluation else "",
        goals_met=evaluation.goals_met if evaluation else None,
        records_uri=situation.records_uri,
        conditions=conditions_of(findings, conditions, situation.generation, situation.now),
    )


def _phase(situation: MissionSituation) -> str:
    progress = situation.progress
    if situation.broken or (progress.evaluated and set(_failures(situation)).issuperset(situation.agents)):
        return FAILED
    if progress.evaluated:
        return SUCCEEDED if progress.weighed else RETRAINING
    return FLYING if situation.running or progress.landed else PENDING


def _failures(situation: MissionSituation) -> dict[str, str]:
    """Why agents failed; the evaluation knows best."""
    told = situation.evaluation.failures if situation.evaluation else {}
    return {**dict.fromkeys(situation.progress.failed, "it failed; see its landing.json"), **situation.failures, **told}


def _agent(situation: MissionSituation, agent: str) -> AgentProgress:
    failures = _failures(situation)
    steps = dict(situation.steps)
    if situation.evaluation:
        steps |= {each.agent: each.steps for each in situation.evaluation.agents}
    phase = FLYING if agent in situation.running else PENDING
    if agent in situation.progress.landed:
        phase = LANDED
    if agent in failures:
        phase = FAILED
    return AgentProgress(name=agent, phase=phase, steps=steps.get(agent, 0), message=shortened(failures.get(agent, "")))


def _findings(situation: MissionSituation, phase: str) -> dict[MissionCondition, Finding]:
    text = _text(situation, phase)
    over, failed = phase == SUCCEEDED, phase == FAILED
    failures = _failures(situation)
    told = "; ".join(f"{agent} failed: {message}" for agent, message in sorted(failures.items()))
    return {
        MissionCondition.READY: yes(phase, text) if over else no(phase, text),
        MissionCondition.RECONCILING: no(phase) if over or failed else yes(phase, text),
        MissionCondition.FLYING: yes(phase, text) if phase == FLYING else no(phase),
        MissionCondition.COMPLETE: yes(phase) if over else no(phase),
        MissionCondition.GOALS_MET: _goals(situation.evaluation),
        MissionCondition.DEGRADED: yes("AgentFailed", told) if failures else no("NoTrouble"),
        MissionCondition.STALLED: yes(phase, text) if failed else no("GoesOn"),
    }


def _goals(evaluation: MissionEvaluation | None) -> Finding:
    if evaluation is None:
        return unknown("NotEvaluated", "the mission has not ended yet")
    truth = yes if evaluation.goals_met else no
    return truth("GoalsMet" if evaluation.goals_met else "GoalsMissed", evaluation_text(evaluation))


def _text(situation: MissionSituation, phase: str) -> str:
    progress = situation.progress
    match phase:
        case "Failed":
            return situation.broken or "every agent failed"
        case "Succeeded":
            return "it was flown and evaluated, and what was learned from it is there"
        case "Retraining":
            return retraining_text(progress)
        case "Flying":
            return f"{len(progress.landed)} of {counted(len(situation.agents), 'agent')} have landed"
        case _:
            return "no agent flies yet"

"""What a fleet is doing, in sentences for people; the same situation gives the same sentence.

No sentence has a time that runs: a message that changes with every look would be a write with every look.
"""

from __future__ import annotations

import math
from typing import assert_never

from fleet.missions.documents import GoalResult, MissionEvaluation
from fleet_operator.policy.lifecycle import (
    Done,
    Failed,
    Fly,
    MissionProgress,
    Order,
    Prepare,
    Progress,
    Retrain,
    Step,
    Suspended,
    Train,
    Wait,
    Weigh,
)
from fleet_operator.policy.times import rfc3339


def step_text(step: Step, progress: Progress, shaped: bool) -> str:  # noqa: PLR0911 - one sentence for each kind of step
    """What a fleet that takes this step is doing."""
    match step:
        case Prepare():
            return "the FleetSpec and its contexts are being copied to storage"
        case Train():
            return "the trainer is training the first model" if shaped else "the trainer is shaping the reward"
        case Order(number=number):
            return f"mission {number} is being ordered"
        case Fly(number=number, agents=agents):
            return _flight_text(number, agents, _mission(progress, number))
        case Retrain(number=number):
            return f"mission {number}: {retraining_text(_mission(progress, number))}"
        case Weigh(number=number):
            return f"mission {number}: the models are being weighed"
        case Wait(number=number, until_s=until_s):
            return f"mission {number} starts at {rfc3339(until_s)}"
        case Suspended(number=number):
            return f"mission {number} is flown when spec.suspend is false again"
        case Failed(reason=reason):
            return reason
        case Done(missions=missions):
            return f"{counted(missions, 'mission')} {'was' if missions == 1 else 'were'} flown"
    assert_never(step)


def retraining_text(mission: MissionProgress) -> str:
    """How many aggregators have reported, of all that are to run; those that were given up never will."""
    return f"{len(mission.retrained)} of {counted(len(mission.due), 'aggregator')} have reported"


def evaluation_text(evaluation: MissionEvaluation) -> str:
    """What became of every goal in a mission, and who failed."""
    goals = ", ".join(_goal_text(result) for result in evaluation.goals)
    failures = "".join(f"; {agent} failed: {message}" for agent, message in sorted(evaluation.failures.items()))
    return f"mission {evaluation.number}: {goals}{failures}"


def goals_count(evaluation: MissionEvaluation) -> str:
    """Goals met, as met/all."""
    return f"{sum(result.met for result in evaluation.goals)}/{len(evaluation.goals)}"


def share(evaluation: MissionEvaluation, metric: str) -> str:
    """A metric of a mission with three decimals; "" when Eval() gave none."""
    value = evaluation.metrics.get(metric, math.nan)
    return f"{value:.3f}" if math.isfinite(value) else ""


def counted(number: int, noun: str) -> str:
    """A number with its noun: `1 agent`, `2 agents`."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _flight_text(number: int, flying: tuple[str, ...], mission: MissionProgress) -> str:
    if mission.landed.issuperset(flying):
        return f"mission {number}: all agents have landed, and it is being evaluated"
    everyone = mission.landed | set(flying)
    return f"mission {number}: {len(mission.landed)} of {counted(len(everyone), 'agent')} have landed"


def _goal_text(result: GoalResult) -> str:
    goal = result.goal
    bounds = [
        f"{word} {bound:g}"
        for word, bound in (("at least", goal.at_least), ("at most", goal.at_most))
        if bound is not None
    ]
    value = "no value" if result.value is None else f"{result.value:.4g}"
    return f"{goal.metric} {value} ({' and '.join(bounds)}: {'met' if result.met else 'missed'})"


def _mission(progress: Progress, number: int) -> MissionProgress:
    return progress.missions[number - 1] if number <= len(progress.missions) else MissionProgress()

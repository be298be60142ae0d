"""What the roles leave for each other in storage about a mission, as typed JSON documents."""

from __future__ import annotations

from pydantic import Field

from fleet.functions.contract import AgentMetrics, Metrics
from fleet.spec.base import Model
from fleet.spec.swarm import Goal

INITIAL = "initial"
"""Key of the model that no subset has retrained: SA of the first training, the empty member of the powerset."""


class ModelReference(Model):
    """A saved SA model and the subset of agents that it was retrained from."""

    key: str = Field(description="`initial`, or the key of a subset.")
    path: str = Field(description="Path in storage.")


class MissionOrder(Model):
    """plan.json: what every role of a mission needs to know."""

    number: int
    context: str = Field(description="Name of the context that is flown over.")
    seed: int
    models: tuple[ModelReference, ...] = Field(description="Models that decisions are blended from.")
    weights: dict[str, dict[str, float]] = Field(description="Weight of each model key, by agent; each sums to 1.")


class Landing(Model):
    """landing.json: how one agent's mission ended. Present means that the agent's part is over."""

    agent: str
    failed: bool = False
    message: str = Field("", description="Why it failed, for the user.")
    metrics: AgentMetrics


class GoalResult(Model):
    """One goal and what became of it."""

    goal: Goal
    value: float | None = Field(description="Value of the metric; None when Eval() gave none.")
    met: bool


class MissionEvaluation(Model):
    """evaluation.json: Eval() of a whole mission. Present means that the mission is over."""

    number: int
    context: str
    metrics: dict[str, float] = Field(description="P of the paper, and the platform's own metrics.")
    goals: tuple[GoalResult, ...]
    agents: tuple[AgentMetrics, ...]
    failures: dict[str, str] = Field({}, description="Why agents failed, by name.")

    @property
    def goals_met(self) -> bool:
        """Whether every goal was met."""
        return all(result.met for result in self.goals)

    @property
    def system(self) -> Metrics:
        """The metrics of all agents."""
        return Metrics(self.agents)


class WeightsDocument(Model):
    """weights.json: what each agent flies with, and how useful the models are."""

    number: int = Field(description="The mission that flies with these weights.")
    weights: dict[str, dict[str, float]] = Field(description="Weight of each model key, by agent; each sums to 1.")
    usefulness: dict[str, float | None] = Field(
        description="Mean weight of each model over the agents; None before the model has flown."
    )


class Expense(Model):
    """What a role that learns has spent; a process that was killed before it wrote this is not in it."""

    cpu_s: float = Field(description="Processor time spent, in s.")
    wall_s: float = Field(description="Time from start to end, in s.")
    energy_j: float = Field(description="Energy of the edge machine for it, by the edge profile.")


class TrainerReport(Expense):
    """What the trainer spent on one task."""

    task: str = Field(description="Train or Weigh.")
    number: int = Field(description="The mission that was weighed; 0 for the training before the first.")


class RetrainingReport(Expense):
    """What one aggregator did after a mission."""

    number: int
    subset: str
    transitions: int = Field(description="Moves that the model learned from.")
    level: int = Field(0, description="Scheduling level that the aggregator ran at, 0..9.", ge=0, le=9)


def judge(goals: tuple[Goal, ...], metrics: dict[str, float]) -> tuple[GoalResult, ...]:
    """Hold the metrics of an evaluation against the goals; a metric that is missing misses its goal."""
    results = []
    for goal in goals:
        value = metrics.get(goal.metric)
        low = goal.at_least is None or (value is not None and value >= goal.at_least)
        high = goal.at_most is None or (value is not None and value <= goal.at_most)
        results.append(GoalResult(goal=goal, value=value, met=value is not None and low and high))
    return tuple(results)

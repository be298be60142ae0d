"""The three custom resources: FleetSpec, Mission, EdgeNode."""

from __future__ import annotations

from enum import StrEnum
from typing import Literal

from pydantic import Field

from fleet.spec.base import API_VERSION, Condition, Duration, Metadata, Model, Name
from fleet.spec.functions import ContextSpec, ContextUse, EvalSpec, MapSpec
from fleet.spec.learning import HASpec, OnlineLearning, RewardShaping, SASpec, Training
from fleet.spec.platform import (
    Aggregation,
    AggregationKind,
    MissionPlan,
    Scheduling,
    StorageSpec,
    UsefulnessScale,
    WorkflowSpec,
)
from fleet.spec.swarm import Agents, Goal, StateSpace

POWERSET_LIMIT = 8
ABSOLUTE_LIMIT = 4


class Fleet(Model):
    """`spec` of a FleetSpec: (N, S, A, Map, Eval, C) and goals of the paper, and how the platform runs them."""

    agents: Agents = Field(Agents(count=1), description="N and A: the agents and their actions.")
    state_space: StateSpace = Field(description="S: the states and their groups.")
    map: MapSpec = Field(description="Map(): sensor data to state-space vector.")
    eval: EvalSpec = Field(description="Eval(): how far the mission is.")
    contexts: tuple[ContextSpec, ...] = Field(description="C: contexts to learn from and to fly over.", min_length=1)
    goals: tuple[Goal, ...] = Field(description="G: what a mission must reach.", min_length=1)
    sa: SASpec = Field(SASpec(), description="State-to-action model.")
    ha: HASpec = Field(HASpec(), description="History-to-action model.")
    reward_shaping: RewardShaping = Field(RewardShaping(), description="How reward and thresholds are found.")
    training: Training = Field(Training(), description="How SA is first trained.")
    online_learning: OnlineLearning = Field(OnlineLearning(), description="How models are retrained and weighed.")
    aggregation: Aggregation = Field(Aggregation(), description="Which subsets of agents retrain a model each.")
    scheduling: Scheduling = Field(Scheduling(), description="Priority and shares by usefulness.")
    storage: StorageSpec = Field(StorageSpec(), description="Where data is kept.")
    missions: MissionPlan = Field(MissionPlan(), description="How many missions, and when.")
    workflow: WorkflowSpec = Field(WorkflowSpec(), description="Resources and edge profile of the roles.")
    suspend: bool = Field(False, description="True stops new missions; a running one ends.")

    @property
    def aggregation_kind(self) -> AggregationKind:
        """The kind of aggregation, with the default for this number of agents."""
        default = AggregationKind.POWERSET
        if len(self.agents.resolved) > POWERSET_LIMIT:
            default = AggregationKind.EACH_AND_ALL
        return self.aggregation.kind or default

    @property
    def usefulness_scale(self) -> UsefulnessScale:
        """How usefulness becomes a level, with the default for this number of agents."""
        few = len(self.agents.resolved) <= ABSOLUTE_LIMIT
        return self.scheduling.usefulness or (UsefulnessScale.ABSOLUTE if few else UsefulnessScale.RELATIVE)

    def contexts_for(self, use: ContextUse) -> tuple[ContextSpec, ...]:
        """The contexts that are for one use, in the order of the FleetSpec."""
        return tuple(context for context in self.contexts if use in context.use)

    def context(self, name: str) -> ContextSpec:
        """The context of a name. Raises KeyError when there is none."""
        return {context.name: context for context in self.contexts}[name]


class FleetStatus(Model):
    """Observed state of a fleet."""

    observed_generation: int = Field(0, description="The metadata.generation that this status speaks of.")
    phase: str = Field("", description="One word for people; programs read the conditions.")
    missions_flown: int = Field(0, description="Missions that have ended.")
    coverage: str = Field("", description="Share of states visited in the last mission.")
    accuracy: str = Field("", description="Accuracy of the last mission.")
    goals_met: str = Field("", description="Goals met in the last mission, as met/all.")
    storage_uri: str = Field("", description="Where the data is.")
    conditions: tuple[Condition, ...] = Field((), description="Conditions, one of each type.")


class FleetSpec(Model):
    """A swarm application: what to fly, what to learn from, and what to reach."""

    api_version: Literal["fleetcomputer.io/v1alpha1"] = API_VERSION
    kind: Literal["FleetSpec"] = "FleetSpec"
    metadata: Metadata
    spec: Fleet
    status: FleetStatus | None = None

    @property
    def name(self) -> str:
        """Name of the fleet."""
        return self.metadata.name


class MissionSpec(Model):
    """`spec` of a Mission: one execution; never changes."""

    fleet: Name = Field(description="Name of the FleetSpec.")
    number: int = Field(description="1 for the first mission of the fleet.", ge=1)
    context: Name = Field(description="The context that is flown over.")
    seed: int = Field(0, description="Seed of everything random in the mission.", ge=0)


class AgentProgress(Model):
    """How far one agent is."""

    name: str = Field(description="Name of the agent.")
    phase: str = Field("", description="Pending, Flying, Landed or Failed.")
    steps: int = Field(0, description="States visited.")
    message: str = Field("", description="Why it failed, when it did.")


class MissionStatus(Model):
    """Observed state of a mission."""

    observed_generation: int = Field(0, description="The metadata.generation that this status speaks of.")
    phase: str = Field("", description="Pending, Flying, Retraining, Succeeded or Failed.")
    agents: tuple[AgentProgress, ...] = Field((), description="How far each agent is.")
    evaluation: dict[str, float] = Field({}, description="Metrics of Eval().")
    goals_met: bool = Field(False, description="Whether every goal was met.")
    records_uri: str = Field("", description="Where the records are.")
    conditions: tuple[Condition, ...] = Field((), description="Conditions, one of each type.")


class Mission(Model):
    """One execution of a FleetSpec."""

    api_version: Literal["fleetcomputer.io/v1alpha1"] = API_VERSION
    kind: Literal["Mission"] = "Mission"
    metadata: Metadata
    spec: MissionSpec
    status: MissionStatus | None = None


class NodeRole(StrEnum):
    """What a machine is for."""

    GATEWAY = "Gateway"
    HUB = "Hub"


class EdgeNodeSpec(Model):
    """`spec` of an EdgeNode: a machine that may be powered down."""

    node: str = Field(description="Name of the Kubernetes node.", min_length=1, max_length=253)
    mac: str = Field(description="MAC address for Wake-on-LAN.", pattern=r"^([0-9A-Fa-f]{2}:){5}[0-9A-Fa-f]{2}$")
    broadcast: str = Field(
        "255.255.255.255", description="Address that the Wake-on-LAN packet is sent to.",
        pattern=r"^([0-9]{1,3}\.){3}[0-9]{1,3}$",
    )  # fmt: skip
    role: NodeRole = Field(NodeRole.GATEWAY, description="Gateway of an agent, or part of the hub.")
    boot_time: Duration = Field("60s", description="Time from the packet to Ready.")
    idle_watts: float = Field(10.0, description="Power when idle, in W.", ge=0)
    busy_watts: float = Field(40.0, description="Power when busy, in W.", ge=0)
    may_power_off: bool = Field(True, description="Whether the autoscaler may power the machine off.")


class EdgeNodeStatus(Model):
    """Observed state of a machine."""

    observed_generation: int = Field(0, description="The metadata.generation that this status speaks of.")
    power: str = Field("", description="State of the power state machine.")
    conditions: tuple[Condition, ...] = Field((), description="Conditions, one of each type.")


class EdgeNode(Model):
    """One machine of the edge site."""

    api_version: Literal["fleetcomputer.io/v1alpha1"] = API_VERSION
    kind: Literal["EdgeNode"] = "EdgeNode"
    metadata: Metadata
    spec: EdgeNodeSpec
    status: EdgeNodeStatus | None = None

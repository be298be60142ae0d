"""The three custom resources: FleetSpec, Mission, EdgeNode."""

from __future__ import annotations

from enum import StrEnum
from typing import Literal

from pydantic import Field

from fleet.spec.base import (
    ABSOLUTE_LIMIT,
    API_VERSION,
    POWERSET_LIMIT,
    Conditions,
    Duration,
    Metadata,
    MissionMetadata,
    Model,
    Name,
    NodeMetadata,
    NodeName,
    Seed,
    named_list,
)
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

ACCURACY = "accuracy"
"""Metric of the built-in parts of Eval(): share of the states whose class is right on the map."""
MAC_PATTERN = r"^([0-9A-Fa-f]{2}:){5}[0-9A-Fa-f]{2}$"
_OCTET = r"(25[0-5]|2[0-4][0-9]|1[0-9]{2}|[1-9]?[0-9])"
IPV4_PATTERN = rf"^({_OCTET}\.){{3}}{_OCTET}$"


class Fleet(Model):
    """`spec` of a FleetSpec: (N, S, A, Map, Eval, C) and goals of the paper, and how the platform runs them."""

    agents: Agents = Field(default=Agents(count=1), description="N and A: the agents and their actions.")
    state_space: StateSpace = Field(description="S: the states and their groups.", examples=["{context: my-field}"])
    map: MapSpec = Field(
        description="Map(): sensor data to state-space vector.", examples=["{function: my_module:map_observation}"]
    )
    eval: EvalSpec = Field(description="Eval(): how far the mission is.", examples=["{function: my_module:evaluate}"])
    contexts: tuple[ContextSpec, ...] = Field(
        description="C: contexts to learn from and to fly over.",
        min_length=1,
        max_length=64,
        json_schema_extra=named_list(),
        examples=["[{name: my-field, uri: contexts/my-field, use: [Mission]}]"],
    )
    goals: tuple[Goal, ...] = Field(
        description="G: what a mission must reach.",
        min_length=1,
        max_length=32,
        json_schema_extra=named_list("metric"),
        examples=["[{metric: accuracy, atLeast: 0.7}]"],
    )
    sa: SASpec = Field(default=SASpec(), description="State-to-action model.")
    ha: HASpec = Field(default=HASpec(), description="History-to-action model.")
    reward_shaping: RewardShaping = Field(default=RewardShaping(), description="How reward and thresholds are found.")
    training: Training = Field(default=Training(), description="How SA is first trained.")
    online_learning: OnlineLearning = Field(
        default=OnlineLearning(), description="How models are retrained and weighed."
    )
    aggregation: Aggregation = Field(default=Aggregation(), description="Which subsets of agents retrain a model each.")
    scheduling: Scheduling = Field(default=Scheduling(), description="Priority and shares by usefulness.")
    storage: StorageSpec = Field(default=StorageSpec(), description="Where data is kept.")
    missions: MissionPlan = Field(default=MissionPlan(), description="How many missions, and when.")
    workflow: WorkflowSpec = Field(default=WorkflowSpec(), description="Resources and edge profile of the roles.")
    suspend: bool = Field(default=False, description="True stops new missions; a running one ends.")

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

    @property
    def accuracy_goal(self) -> float | None:
        """The accuracy that a mission must reach; None when no goal asks for any."""
        asked = [goal.at_least for goal in self.goals if goal.metric == ACCURACY and goal.at_least is not None]
        return max(asked, default=None)

    def contexts_for(self, use: ContextUse) -> tuple[ContextSpec, ...]:
        """The contexts that are for one use, in the order of the FleetSpec."""
        return tuple(context for context in self.contexts if use in context.use)

    def context(self, name: str) -> ContextSpec:
        """The context of a name. Raises KeyError when there is none."""
        return {context.name: context for context in self.contexts}[name]


class FleetStatus(Model):
    """Observed state of a fleet."""

    observed_generation: int = Field(default=0, description="The metadata.generation that this status speaks of.")
    phase: str = Field(
        default="",
        description="One word for people: Pending, Refused, Preparing, Training, Flying, Retraining, Weighing, "
        "Waiting, Suspended, Done or Failed. Programs read the conditions.",
    )
    mission: int = Field(default=0, description="The mission that was ordered last; 0 before the first.")
    missions_flown: int = Field(default=0, description="Missions that have ended.")
    missions: str = Field(default="", description="Missions that have ended, of all, as ended/all.")
    coverage: str = Field(default="", description="Share of states visited in the last mission.")
    accuracy: str = Field(default="", description="Accuracy of the last mission.")
    goals: str = Field(default="", description="Goals met in the last mission, as met/all.")
    next_mission: str = Field(default="", description="When the next mission starts, RFC 3339; empty when none waits.")
    storage_uri: str = Field(default="", description="Where the data is.")
    conditions: Conditions = Field(default=(), description="Conditions, one of each type.")


class FleetSpec(Model):
    """A swarm application: what to fly, what to learn from, and what to reach."""

    api_version: Literal["fleetcomputer.io/v1alpha1"] = API_VERSION
    kind: Literal["FleetSpec"] = "FleetSpec"
    metadata: Metadata = Field(description="Kubernetes' own.", examples=["{name: my-fleet}"])
    spec: Fleet = Field(description="What to fly, what to learn from, and what to reach.", examples=["..."])
    status: FleetStatus | None = None

    @property
    def name(self) -> str:
        """Name of the fleet."""
        return self.metadata.name


class MissionSpec(Model):
    """`spec` of a Mission: one execution; never changes."""

    fleet: Name = Field(description="Name of the FleetSpec.", examples=["crop-scouting"])
    number: int = Field(description="1 for the first mission of the fleet.", ge=1, le=10000, examples=[1])
    context: Name = Field(description="The context that is flown over.", examples=["field-2018-09-16"])
    seed: Seed = Field(default=0, description="Seed of everything random in the mission.")


class AgentProgress(Model):
    """How far one agent is."""

    name: Name = Field(description="Name of the agent.")
    phase: str = Field(default="", description="Pending, Flying, Landed or Failed.")
    steps: int = Field(default=0, description="States visited.")
    message: str = Field(default="", description="Why it failed, when it did.")


class MissionStatus(Model):
    """Observed state of a mission."""

    observed_generation: int = Field(default=0, description="The metadata.generation that this status speaks of.")
    phase: str = Field(default="", description="Pending, Flying, Retraining, Succeeded or Failed.")
    agents: tuple[AgentProgress, ...] = Field(
        default=(), description="How far each agent is.", max_length=1000, json_schema_extra=named_list()
    )
    landed: str = Field(default="", description="Agents that have landed, of all, as landed/all.")
    evaluation: dict[str, float] = Field(default={}, description="Metrics of Eval().", max_length=256)
    coverage: str = Field(default="", description="Share of states visited.")
    accuracy: str = Field(default="", description="Accuracy.")
    goals: str = Field(default="", description="Goals met, as met/all.")
    goals_met: bool | None = Field(default=None, description="Whether every goal was met.")
    records_uri: str = Field(default="", description="Where the records are.")
    conditions: Conditions = Field(default=(), description="Conditions, one of each type.")


class Mission(Model):
    """One execution of a FleetSpec."""

    api_version: Literal["fleetcomputer.io/v1alpha1"] = API_VERSION
    kind: Literal["Mission"] = "Mission"
    metadata: MissionMetadata = Field(description="Kubernetes' own.", examples=["{name: my-name}"])
    spec: MissionSpec = Field(description="One execution; never changes.", examples=["..."])
    status: MissionStatus | None = None


class NodeRole(StrEnum):
    """What a machine is for."""

    GATEWAY = "Gateway"
    HUB = "Hub"


class EdgeNodeSpec(Model):
    """`spec` of an EdgeNode: a machine that may be powered down."""

    node: NodeName = Field(description="Name of the Kubernetes node.", examples=["hub-1"])
    mac: str = Field(
        description="MAC address for Wake-on-LAN.", pattern=MAC_PATTERN, max_length=17, examples=["00:1a:2b:3c:4d:5e"]
    )
    broadcast: str = Field(
        default="255.255.255.255",
        description="Address that the Wake-on-LAN packet is sent to.",
        pattern=IPV4_PATTERN,
        max_length=15,
    )
    role: NodeRole = Field(default=NodeRole.GATEWAY, description="Gateway of an agent, or part of the hub.")
    boot_time: Duration = Field(default="60s", description="Time from the packet to Ready.")
    idle_watts: float = Field(default=10.0, description="Power when idle, in W.", ge=0)
    busy_watts: float = Field(default=40.0, description="Power when busy, in W.", ge=0)
    may_power_off: bool = Field(default=True, description="Whether the autoscaler may power the machine off.")


class EdgeNodeStatus(Model):
    """Observed state of a machine."""

    observed_generation: int = Field(default=0, description="The metadata.generation that this status speaks of.")
    power: str = Field(default="", description="State of the power state machine.")
    conditions: Conditions = Field(default=(), description="Conditions, one of each type.")


class EdgeNode(Model):
    """One machine of the edge site."""

    api_version: Literal["fleetcomputer.io/v1alpha1"] = API_VERSION
    kind: Literal["EdgeNode"] = "EdgeNode"
    metadata: NodeMetadata = Field(description="Kubernetes' own.", examples=["{name: my-name}"])
    spec: EdgeNodeSpec = Field(description="The machine.", examples=["..."])
    status: EdgeNodeStatus | None = None

"""What the platform does around the learning: aggregation, scheduling, storage, missions."""

from __future__ import annotations

from enum import StrEnum

from pydantic import Field

from fleet.spec.base import (
    Duration,
    Fraction,
    FunctionReference,
    Model,
    ProfileReference,
    Quantity,
    Resources,
    Seed,
    Uri,
)
from fleet.spec.schedule import Schedule


class AggregationKind(StrEnum):
    """Which subsets of agents get an aggregator."""

    POWERSET = "Powerset"
    EACH_AND_ALL = "EachAndAll"
    NEIGHBOURS = "Neighbours"
    CUSTOM = "Custom"


class Pruning(Model):
    """When a model is no longer retrained."""

    below: Fraction = Field(default=0.0, description="Usefulness under which a model is pruned; 0 prunes nothing.")
    after: int = Field(
        default=2, description="Missions in a row under the threshold before a model is pruned.", ge=1, le=10000
    )


class Aggregation(Model):
    """Which subsets of the agents' data retrain a model each."""

    kind: AggregationKind | None = Field(
        default=None,
        description="Powerset (default up to 8 agents), a heuristic (EachAndAll is the default above), or Custom.",
    )
    function: FunctionReference | None = Field(
        default=None, description="For Custom: `module:function` from the agents' names to a list of lists of names."
    )
    pruning: Pruning = Field(default=Pruning(), description="When a model is no longer retrained.")
    resources: Resources = Field(default=Resources(), description="CPU and memory of an aggregator.")


class UsefulnessScale(StrEnum):
    """How usefulness becomes a level."""

    ABSOLUTE = "Absolute"
    RELATIVE = "Relative"


class Scheduling(Model):
    """Priority and shares by usefulness."""

    usefulness: UsefulnessScale | None = Field(
        default=None, description="Absolute is the paper's; Relative (default above 4 agents) divides by the largest."
    )
    cpu: Quantity | None = Field(
        default=None, description="CPU that all aggregators share; all that is allocatable when left out."
    )
    memory: Quantity | None = Field(default=None, description="Memory that all aggregators share.")


class DeletionPolicy(StrEnum):
    """What happens to the stored data when the FleetSpec is deleted."""

    RETAIN = "Retain"
    DELETE = "Delete"


STORAGE_ADDRESS = "^(file://(localhost)?/|webhdfs://[^/]+/)[^/]"
"""What the address of a storage begins with, for Python and for CEL; `fleet.storage` says the rest."""
STORAGE_EXAMPLES = "webhdfs://fleet@namenode:9870/fleet or file:///var/fleet"


class StorageSpec(Model):
    """Where observations, models and evaluations are kept."""

    uri: Uri | None = Field(
        default=None,
        description="Address of the storage, as `webhdfs://fleet@namenode:9870/fleet` (HDFS) or `file:///var/fleet` (a "
        "folder); the platform's own when left out.",
    )
    replication: int = Field(default=2, description="Copies of each object, where the storage replicates.", ge=1, le=10)
    on_delete: DeletionPolicy = Field(
        default=DeletionPolicy.RETAIN, description="What happens to the data when the FleetSpec is deleted."
    )


class ClockMode(StrEnum):
    """Whether missions last as long as they say."""

    REAL = "Real"
    ACCELERATED = "Accelerated"


class MissionPlan(Model):
    """How many missions, and when."""

    count: int = Field(default=1, description="Number of missions.", ge=1, le=10000)
    interval: Duration = Field(default="0s", description="Time from the end of a mission to the start of the next.")
    schedule: Schedule | None = Field(
        default=None,
        description="When missions start, as cron writes it, in UTC: `0 6 * * 1-5`. In place of `interval`. "
        "A start is up to 10 minutes late when the fleet or the operator was busy, and is left out after that.",
    )
    clock: ClockMode = Field(
        default=ClockMode.ACCELERATED,
        description="Accelerated: replayed actions take no time, but are accounted in full. `fleet run` then waits "
        "neither for `interval` nor for `schedule`; a cluster does.",
    )
    seed: Seed = Field(default=0, description="Seed of everything that is random.")
    agent_retries: int = Field(
        default=20,
        description="How often a sensor or a workflow is started again; trainer and aggregators at most 6 times.",
        ge=0,
        le=1000,
    )


class Deciding(StrEnum):
    """What an agent does while Map() and SA run."""

    WHILE_MOVING = "WhileMoving"
    HOVERING = "Hovering"


class WorkflowSpec(Model):
    """The AS workflow and sensor of each agent, and the trainer."""

    resources: Resources = Field(default=Resources(), description="CPU and memory of an AS workflow.")
    sensor_resources: Resources = Field(default=Resources(), description="CPU and memory of a sensor.")
    trainer_resources: Resources = Field(default=Resources(), description="CPU and memory of the trainer.")
    edge_profile: ProfileReference = Field(
        default="laptop-i5",
        description="Energy and time of edge tasks: a built-in profile, or a file's path and `#name`.",
    )
    decide: Deciding = Field(
        default=Deciding.WHILE_MOVING,
        description="Whether an agent flies on while it decides, or hovers (costs energy).",
    )

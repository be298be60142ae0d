"""N, A and S of the FleetSpec: the agents, what they can do, and the states they move through."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated

from pydantic import Field

from fleet.spec.base import MetricName, Model, Name, Positive, ProfileReference, distinct, named_list


class Action(StrEnum):
    """A move to a neighbouring state. North is towards the first row unless the context says otherwise."""

    NORTH = "North"
    SOUTH = "South"
    EAST = "East"
    WEST = "West"
    NORTH_EAST = "NorthEast"
    NORTH_WEST = "NorthWest"
    SOUTH_EAST = "SouthEast"
    SOUTH_WEST = "SouthWest"


CARDINAL = (Action.NORTH, Action.SOUTH, Action.EAST, Action.WEST)


class DriverName(StrEnum):
    """Action drivers that the platform has."""

    REPLAY = "Replay"


class Capability(StrEnum):
    """What a mission may demand of an action driver (a qualitative requirement)."""

    TAKE_OFF = "TakeOff"
    LAND = "Land"
    MOVE = "Move"
    WAYPOINT = "Waypoint"
    CAPTURE = "Capture"
    GIMBAL = "Gimbal"


CAPABILITIES: Mapping[DriverName, frozenset[Capability]] = {
    DriverName.REPLAY: frozenset(
        {Capability.TAKE_OFF, Capability.LAND, Capability.MOVE, Capability.WAYPOINT, Capability.CAPTURE}
    ),
}
"""What each action driver can do."""

Actions = Annotated[tuple[Action, ...], Field(min_length=1, max_length=8)]


class Start(Model):
    """The state in which an agent takes off, in rows and columns of the context's source."""

    row: int = Field(description="Row of the take-off cell.", ge=0, le=1_000_000, examples=[0])
    column: int = Field(description="Column of the take-off cell.", ge=0, le=1_000_000, examples=[0])


class AgentSpec(Model):
    """One agent; what is left out is as in `agents`."""

    name: Name = Field(description="Unique within the fleet; part of the names of its pods.", examples=["scout"])
    driver: DriverName | None = Field(default=None, description="Action driver of this agent.")
    actions: Actions | None = Field(
        default=None,
        description="Moves that SA may choose: A_i of the paper; travel between groups is by waypoint.",
        json_schema_extra=distinct(),
    )
    start: Start | None = Field(default=None, description="Take-off cell; the first cell of its part when left out.")


class Agents(Model):
    """N and A: how many agents, and what each can do. Give `count`, or `members` when they differ."""

    count: int | None = Field(
        default=None, description="Number of equal agents, named agent-1, agent-2, ...", ge=1, le=1000
    )
    members: tuple[AgentSpec, ...] = Field(
        default=(),
        description="The agents one by one, when they differ.",
        max_length=1000,
        json_schema_extra=named_list(),
    )
    driver: DriverName = Field(default=DriverName.REPLAY, description="Action driver of every agent that names none.")
    actions: Actions = Field(
        default=CARDINAL,
        description="Moves that SA may choose, of every agent that names none; travel between groups is by waypoint.",
        json_schema_extra=distinct(),
    )
    requires: tuple[Capability, ...] = Field(
        default=(),
        description="What the action driver must be able to do (qualitative requirements).",
        max_length=16,
        json_schema_extra=distinct(),
    )
    energy_profile: ProfileReference = Field(
        default="spark-survey",
        description="Energy and time of the agents' actions: a built-in profile, or a file's path and `#name`.",
    )

    @property
    def resolved(self) -> tuple[AgentSpec, ...]:
        """Every agent with nothing left out but perhaps its start."""
        members = self.members or tuple(AgentSpec(name=f"agent-{i + 1}") for i in range(self.count or 1))
        return tuple(
            member.model_copy(
                update={"driver": member.driver or self.driver, "actions": member.actions or self.actions}
            )
            for member in members
        )


class GroupOrder(StrEnum):
    """In which order the state groups are visited."""

    SERPENTINE = "Serpentine"
    ROW_MAJOR = "RowMajor"
    COLUMN_SERPENTINE = "ColumnSerpentine"
    NEAREST = "Nearest"


class Groups(Model):
    """State groups: blocks of neighbouring states within which SA chooses and HA decides when to leave."""

    rows: int = Field(default=3, description="Rows of states in a group.", ge=1, le=64)
    columns: int = Field(default=3, description="Columns of states in a group.", ge=1, le=64)
    order: GroupOrder = Field(default=GroupOrder.SERPENTINE, description="Order in which groups are visited.")


class StateSpace(Model):
    """S: the context whose states the missions move through, and how states form groups."""

    context: Name = Field(description="Name of the context that missions fly over.", examples=["field-2018-09-16"])
    groups: Groups = Field(default=Groups(), description="How states form groups.")
    capture_in_transit: bool = Field(
        default=True, description="Whether states that are passed on the way to the next group are captured too."
    )


class Goal(Model):
    """One goal: a metric of Eval() and the value that it must reach or must not pass."""

    metric: MetricName = Field(description="Name of a metric that Eval() returns.", examples=["accuracy"])
    at_least: float | None = Field(default=None, description="The metric must reach this value.")
    at_most: float | None = Field(default=None, description="The metric must not pass this value.")
    weight: Positive = Field(default=1.0, description="How much a miss counts against a miss of another goal.")

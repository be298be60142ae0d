"""N, A and S of the FleetSpec: the agents, what they can do, and the states they move through."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from fleet.spec.base import Model, Name, Positive


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


class Start(Model):
    """The state in which an agent takes off, in rows and columns of the context's source."""

    row: int = Field(description="Row of the take-off cell.", ge=0)
    column: int = Field(description="Column of the take-off cell.", ge=0)


class AgentSpec(Model):
    """One agent; what is left out is as in `agents`."""

    name: Name = Field(description="Unique within the fleet; part of the names of its pods.")
    driver: DriverName | None = Field(None, description="Action driver of this agent.")
    actions: Annotated[tuple[Action, ...], Field(min_length=1)] | None = Field(
        None, description="Actions of this agent: A_i of the paper."
    )
    start: Start | None = Field(None, description="Take-off cell; the first cell of its part when left out.")


class Agents(Model):
    """N and A: how many agents, and what each can do. Give `count`, or `members` when they differ."""

    count: int | None = Field(None, description="Number of equal agents, named agent-1, agent-2, ...", ge=1, le=1000)
    members: tuple[AgentSpec, ...] = Field((), description="The agents one by one, when they differ.", max_length=1000)
    driver: DriverName = Field(DriverName.REPLAY, description="Action driver of every agent that names none.")
    actions: Annotated[tuple[Action, ...], Field(min_length=1)] = Field(
        CARDINAL, description="Actions of every agent that names none."
    )
    requires: tuple[Capability, ...] = Field(
        (), description="What the action driver must be able to do (qualitative requirements)."
    )
    energy_profile: str = Field(
        "spark-survey",
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

    rows: int = Field(3, description="Rows of states in a group.", ge=1, le=64)
    columns: int = Field(3, description="Columns of states in a group.", ge=1, le=64)
    order: GroupOrder = Field(GroupOrder.SERPENTINE, description="Order in which groups are visited.")


class StateSpace(Model):
    """S: the context whose states the missions move through, and how states form groups."""

    context: Name = Field(description="Name of the context that missions fly over.")
    groups: Groups = Field(Groups(), description="How states form groups.")
    capture_in_transit: bool = Field(
        True, description="Whether states that are passed on the way to the next group are captured too."
    )


class Goal(Model):
    """One goal: a metric of Eval() and the value that it must reach or must not pass."""

    metric: str = Field(description="Name of a metric that Eval() returns.", pattern=r"^[a-z][a-z0-9_]*$")
    at_least: float | None = Field(None, description="The metric must reach this value.")
    at_most: float | None = Field(None, description="The metric must not pass this value.")
    weight: Positive = Field(1.0, description="How much a miss counts against a miss of another goal.")

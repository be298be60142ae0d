"""The port to a vehicle: how a sensor role moves it and senses with it.

Commands are numbered, so that a role which was killed may say the last one again: a command that was carried out is
not carried out twice. Command 0 takes off; command k leaves the state of step k - 1; the last one lands.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from fleet.contexts.base import Environment, Observation
from fleet.errors import DriverError


class Manoeuvre(StrEnum):
    """Commands that are not moves to a neighbouring state."""

    TAKE_OFF = "TakeOff"
    LAND = "Land"


class OutOfStep(DriverError):
    """The vehicle is not where the caller believes: commands are missing, or were already carried out."""


@dataclass(frozen=True)
class Telemetry:
    """Where the vehicle is.

    Args:
        executed: Number of commands carried out; the next command has this number.
        cell: State of the vehicle.
        airborne: False before take-off and after landing.
    """

    executed: int
    cell: int
    airborne: bool


class Driver(Protocol):
    """An action driver: turns actions into movements of one vehicle."""

    @property
    def environment(self) -> Environment:
        """Where the vehicle flies."""

    def telemetry(self) -> Telemetry:
        """Where the vehicle is now."""

    def act(self, number: int, command: str) -> Telemetry:
        """Carry out a command, and return when it is done; a repeated number answers without a movement.

        Args:
            number: The command's number.
            command: The name of an Action or a Manoeuvre.

        Raises:
            OutOfStep: commands before this one were not carried out.
            DriverError: the command is muted: it would leave the allowed states.
        """

    def sense(self, executed: int) -> Observation:
        """What the sensors observe in the current state.

        Args:
            executed: Number of commands that the caller believes were carried out.

        Raises:
            OutOfStep: another number of commands was carried out.
        """

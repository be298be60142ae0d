"""The Replay driver: a vehicle that flies over a context, and senses what was once observed there.

Source: paper, section "Architecture" of the evaluation (UAV are simulated by replaying captured data).
"""

from __future__ import annotations

from collections.abc import Sequence

from fleet.clock import Clock
from fleet.contexts.base import Context, Environment, Observation
from fleet.drivers.port import Manoeuvre, OutOfStep, Telemetry
from fleet.energy.accounting import EnergyModel
from fleet.errors import DriverError
from fleet.missions.records import Record
from fleet.spec.swarm import Action


class ReplayDriver:
    """A vehicle over a context.

    Args:
        context: What is observed in each state.
        start: Take-off cell.
        energy: Gives the time that an action takes.
        clock: Waits for that time; a clock that does not wait accelerates the mission.
    """

    def __init__(self, context: Context, start: int, energy: EnergyModel, clock: Clock) -> None:
        self._context = context
        self._energy = energy
        self._clock = clock
        self._at = Telemetry(executed=0, cell=start, airborne=False)

    def restore(self, log: Sequence[Record]) -> None:
        """Put the vehicle where the agent's log says that it was: in the last recorded state."""
        if log:
            self._at = Telemetry(executed=len(log), cell=log[-1].cell, airborne=True)

    @property
    def environment(self) -> Environment:
        """Where the vehicle flies."""
        return self._context.environment

    def telemetry(self) -> Telemetry:
        """Where the vehicle is now."""
        return self._at

    def act(self, number: int, command: str) -> Telemetry:
        """Carry out a command; see `Driver.act`."""
        if number == self._at.executed - 1:
            return self._at
        if number != self._at.executed:
            raise OutOfStep(f"command {number} was sent, but the vehicle waits for command {self._at.executed}")
        cell, duration_s = self._carry_out(command)
        self._clock.sleep(duration_s)
        self._at = Telemetry(number + 1, cell, airborne=command != Manoeuvre.LAND)
        return self._at

    def sense(self, executed: int) -> Observation:
        """What was once observed in the current state; see `Driver.sense`."""
        if executed != self._at.executed:
            raise OutOfStep(f"{executed} commands were expected, but the vehicle carried out {self._at.executed}")
        observation = self._context.observe(self._at.cell)
        self._clock.sleep(self._energy.capture().time_s)
        return observation

    def _carry_out(self, command: str) -> tuple[int, float]:
        """The cell after a command and how long the command takes."""
        if command == Manoeuvre.TAKE_OFF and not self._at.airborne:
            return self._at.cell, self._energy.take_off().time_s
        if not self._at.airborne:
            raise DriverError(f"{command}: the vehicle is on the ground; take off first")
        if command == Manoeuvre.LAND:
            return self._at.cell, self._energy.land().time_s
        if command not in set(Action):
            raise DriverError(f"the Replay driver has no command {command!r}")
        action = Action(command)
        cell = self.environment.grid.neighbour(self._at.cell, action)
        if cell is None:
            raise DriverError(f"{action} is muted: it would leave the field")
        return cell, self._energy.move(action).time_s

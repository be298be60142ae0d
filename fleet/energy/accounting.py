"""What a flight costs: time and energy of the aircraft, and energy of the edge machine that serves it.

A flight is counted once and accounted from its counts, so that a simulated and a flown mission agree to the last bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from fleet.energy.profiles import AircraftProfile, EdgeProfile, Task
from fleet.spec.swarm import Action

_ACTIONS = tuple(Action)
_DIAGONAL = frozenset({Action.NORTH_EAST, Action.NORTH_WEST, Action.SOUTH_EAST, Action.SOUTH_WEST})


@dataclass(frozen=True)
class Cost:
    """Time in s and energy of the aircraft in J."""

    time_s: float = 0.0
    energy_j: float = 0.0

    def __add__(self, other: Cost) -> Cost:
        return Cost(self.time_s + other.time_s, self.energy_j + other.energy_j)

    def __mul__(self, times: float) -> Cost:
        return Cost(self.time_s * times, self.energy_j * times)


@dataclass(frozen=True)
class FlightCounts:
    """What one agent did in a flight.

    Args:
        moves: How often each action was flown, in the order of `fleet.spec.swarm.Action`.
        captures: States captured.
        decisions: States in which SA was asked.
        steps: States visited, the take-off cell included.
    """

    moves: tuple[int, ...]
    captures: int
    decisions: int
    steps: int


@dataclass(frozen=True)
class EnergyModel:
    """Costs of one agent.

    Args:
        aircraft: Costs of its actions.
        edge: Costs of the tasks of its edge machine.
        hovering: Whether the aircraft hovers from the picture to SA's choice, in every state in which SA is asked.
            Where nothing is asked, the aircraft flies on while the picture is sent.
    """

    aircraft: AircraftProfile
    edge: EdgeProfile
    hovering: bool = False

    def move(self, action: Action) -> Cost:
        """One cell's move."""
        if action in _DIAGONAL:
            return _cost(self.aircraft.forward) * math.sqrt(2)
        return _cost(self._straight(action))

    def capture(self) -> Cost:
        """Sensing one state."""
        return _cost(self.aircraft.capture)

    def take_off(self) -> Cost:
        """Taking off, once a flight."""
        return _cost(self.aircraft.takeoff)

    def land(self) -> Cost:
        """Landing, once a flight."""
        return _cost(self.aircraft.land)

    def decision(self) -> Cost:
        """Waiting for SA's choice: nothing when the agent decides while it moves."""
        if not self.hovering:
            return Cost()
        wait_s = self.edge.state_s
        return Cost(wait_s, self.aircraft.hover.power_w * wait_s)

    def flight(self, counts: FlightCounts) -> Cost:
        """A whole flight, take-off and landing included.

        Raises:
            ValueError: `counts.moves` has not one number for each action.
        """
        total = self.take_off() + self.land() + self.capture() * counts.captures + self.decision() * counts.decisions
        for action, moves in zip(_ACTIONS, counts.moves, strict=True):
            total += self.move(action) * moves
        return total

    def edge_energy_j(self, counts: FlightCounts, time_s: float) -> float:
        """Energy of the edge machine over a flight.

        Idle power for the whole time; on top of it, what the tasks draw beyond idle: a picture sent and its features
        extracted for every captured state, a choice made for every decision.

        Args:
            counts: What the agent did.
            time_s: How long the machine was on: the flight's time, or the mission's.
        """
        captured_j = self._beyond_idle_j(self.edge.send_image) + self._beyond_idle_j(self.edge.extract_features)
        decided_j = self._beyond_idle_j(self.edge.decide)
        return captured_j * counts.captures + decided_j * counts.decisions + self.edge.idle.power_w * time_s

    def retraining_energy_j(self, cpu_s: float) -> float:
        """Energy of an edge machine that retrains a model: busy power for the processor time.

        This is what one process alone on the machine costs: an upper bound when several share it.
        """
        return self.edge.busy_w * cpu_s

    def _straight(self, action: Action) -> Task:
        match action:
            case Action.NORTH:
                return self.aircraft.forward
            case Action.SOUTH:
                return self.aircraft.backward
            case Action.EAST:
                return self.aircraft.right
            case _:
                return self.aircraft.left

    def _beyond_idle_j(self, task: Task) -> float:
        return max(0.0, task.power_w - self.edge.idle.power_w) * task.time_s


def _cost(task: Task) -> Cost:
    return Cost(task.time_s, task.energy_j)

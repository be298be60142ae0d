"""What an agent has done and spent so far in a mission."""

from __future__ import annotations

from fleet.energy.accounting import Cost, EnergyModel, FlightCounts
from fleet.missions.layout import MOVES


class Odometer:
    """Counts and costs of a flight that is under way, take-off included.

    Args:
        energy: What each action costs.
    """

    def __init__(self, energy: EnergyModel) -> None:
        self._energy = energy
        self._moves = [0] * len(MOVES)
        self._captures = self._decisions = self._steps = 0
        self.time_s = 0.0
        self.energy_j = 0.0
        self._spend(energy.take_off())

    @property
    def counts(self) -> FlightCounts:
        """Everything done so far."""
        return FlightCounts(tuple(self._moves), self._captures, self._decisions, self._steps)

    def arrive(self) -> None:
        """The vehicle has reached a state."""
        self._steps += 1

    def capture(self) -> None:
        """A state was sensed."""
        self._captures += 1
        self._spend(self._energy.capture())

    def decide(self) -> None:
        """SA was asked."""
        self._decisions += 1
        self._spend(self._energy.decision())

    def move(self, move: int) -> None:
        """The vehicle leaves a state."""
        self._moves[move] += 1
        self._spend(self._energy.move(MOVES[move]))

    def _spend(self, cost: Cost) -> None:
        self.time_s += cost.time_s
        self.energy_j += cost.energy_j

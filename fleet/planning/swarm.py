"""A simulated mission of a swarm whose agents hear of each other at once.

Events happen in the order of mission time, of equal times in the order of agents: a mission is the same however fast it
is computed, and the same that agents fly which hear of each other through storage.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from fleet.contexts.grid import Grid
from fleet.energy.accounting import EnergyModel
from fleet.functions.belief import Belief
from fleet.missions.odometer import Odometer
from fleet.missions.partition import parts
from fleet.planning.scouting import Ending, Scout, Scouting
from fleet.planning.stop import StopRule
from fleet.planning.tactics import Tactics

Sense = Callable[[int], float]
"""From a cell with data to the quantity that is captured there; a finite number."""


def scattered(grid: Grid, agents: int, seed: int) -> list[Scout]:
    """Agents that take off each in a part of the field of its own, somewhere.

    Raises:
        MissionError: there are fewer cells with data than agents.
    """
    generator = np.random.default_rng(seed)
    return [Scout(int(generator.choice(part))) for part in parts(grid, agents)]


@dataclass(eq=False)
class Trace:
    """The flight of one agent.

    Args:
        odometer: What it has done and spent, without landing.
        cells, captured: Where it was, and which visits captured the cell.
        own: The cells that it has captured.
        ending: Why it landed; None in the air.
        looked: How many cells were captured by all when it looked last.
    """

    odometer: Odometer
    cells: list[int] = field(default_factory=list)
    captured: list[bool] = field(default_factory=list)
    own: set[int] = field(default_factory=set)
    ending: Ending | None = None
    looked: int = 0


class Swarm(Scouting):
    """A mission of a swarm; arguments as of `Scouting`."""

    def __init__(
        self,
        belief: Belief,
        energy: EnergyModel,
        scouts: Sequence[Scout],
        tactics: Tactics,
        rule: StopRule | None = None,
    ) -> None:
        super().__init__(belief, energy, scouts, tactics, rule)
        self.traces = [Trace(Odometer(energy)) for _ in self.scouts]
        self._order: dict[int, int] = {}

    @property
    def spent_j(self) -> float:
        """Energy that all agents have spent when they land where they are."""
        return sum(trace.odometer.energy_j + self.energy.land().energy_j for trace in self.traces)

    @property
    def captured(self) -> list[int]:
        """All captured cells in the order of time."""
        return list(self._order)

    def fly(self, sense: Sense, watch: Callable[[], bool] | None = None) -> None:
        """Fly until the stop rule is met, or until every cell is captured.

        Args:
            sense: The sensor.
            watch: Called after each claim; the mission ends there when it says so.
        Raises:
            MissionError: the sensor gave no finite number.
        """
        events = [(trace.odometer.time_s, index) for index, trace in enumerate(self.traces)]
        while events:
            time_s, index = heapq.heappop(events)
            scout, trace = self.scouts[index], self.traces[index]
            self._arrive(scout, trace, sense)
            if self.is_due(scout):
                trace.looked = len(self._order)
                trace.ending = self.look(scout, time_s)
                if watch is not None and watch():
                    return
                if trace.ending is not None:
                    continue
                trace.odometer.decide()
            trace.odometer.move(self.advance(scout))
            heapq.heappush(events, (trace.odometer.time_s, index))

    def _arrive(self, scout: Scout, trace: Trace, sense: Sense) -> None:
        """Capture the cell that was reached, unless it has no data or the agent knows it."""
        trace.odometer.arrive()
        fresh = self._is_new_to(trace, scout.cell)
        trace.cells.append(scout.cell)
        trace.captured.append(fresh)
        if fresh:
            trace.own.add(scout.cell)
            self._order.setdefault(scout.cell, len(self._order))
            trace.odometer.capture()
            self.take_in(scout.cell, sense(scout.cell))

    def _is_new_to(self, trace: Trace, cell: int) -> bool:
        """Whether an agent has neither captured a cell with data nor heard of it when it looked last."""
        heard = self._order.get(cell, trace.looked) < trace.looked
        return bool(self.grid.valid.flat[cell]) and not heard and cell not in trace.own

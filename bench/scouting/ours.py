"""The platform's own swarm as a plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.scouting.fields import Field
from bench.scouting.flight import ENERGY, Flights, flown
from fleet.planning.swarm import Swarm, Tactics


@dataclass(frozen=True)
class Ours:
    """Flies on to the end, and is judged all along its way."""

    tactics: Tactics = Tactics()
    name: str = "belief, planned"

    def budgets(self, field: Field) -> tuple[float, ...]:
        """None."""
        return ()

    def fly(self, field: Field, agents: int, seed: int, budget: float | None) -> Flights:
        """Fly until every cell is captured."""
        swarm = Swarm(field.grid, ENERGY, agents, self.tactics, seed)
        swarm.fly(lambda cell: float(field.truth[cell]))
        return tuple(flown(field.grid, np.array(scout.cells), np.array(scout.captured)) for scout in swarm.scouts)

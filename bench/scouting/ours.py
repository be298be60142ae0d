"""The platform's own swarm as a plan, and the same swarm without what it has learned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.scouting.fields import Field
from bench.scouting.flight import ENERGY, Flights, flown
from fleet.functions.belief import Belief
from fleet.missions.layout import MOVES
from fleet.planning.paths import STRAIGHT
from fleet.planning.scouting import Scout
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import InterestWeights, Tactics

DEFAULT = Tactics()
DOUBT_ONLY = Tactics(weights=InterestWeights(doubt_around=0.0, novelty=0.0))


class Wanderers(Swarm):
    """The same starts, but random moves to cells that are not captured."""

    def __init__(self, field: Field, agents: int, tactics: Tactics, seed: int) -> None:
        super().__init__(Belief(field.grid), ENERGY, scattered(field.grid, agents, seed), tactics)
        self._generator = np.random.default_rng([seed, 1])
        self._field = field

    def choose_path(self, scout: Scout) -> tuple[int, ...]:
        """One random move; where none leads to a new cell, the way to the nearest one."""
        grid, free = self._field.grid, self.belief.free
        moves = []
        for move in range(STRAIGHT):
            cell = grid.neighbour(scout.cell, MOVES[move])
            if cell is not None and free.flat[cell]:
                moves.append(move)
        if moves:
            return (int(self._generator.choice(moves)),)
        left = np.argwhere(free)
        way = np.abs(left - grid.position(scout.cell)).sum(axis=1)
        return self.finder.towards(scout.cell, grid.cell(*left[int(way.argmin())].tolist()))


@dataclass(frozen=True)
class Ours:
    """Flies on to the end, and is judged all along its way.

    Args:
        name: For tables.
        tactics: How it scouts.
        wanders: Whether its moves are random.
    """

    name: str = "belief, planned"
    tactics: Tactics = DEFAULT
    wanders: bool = False

    def budgets(self, field: Field) -> tuple[float, ...]:
        """None."""
        return ()

    def fly(self, field: Field, agents: int, seed: int, budget: float | None) -> Flights:
        """Fly until every cell is captured."""
        if self.wanders:
            swarm: Swarm = Wanderers(field, agents, self.tactics, seed)
        else:
            swarm = Swarm(Belief(field.grid), ENERGY, scattered(field.grid, agents, seed), self.tactics)
        swarm.fly(lambda cell: float(field.truth[cell]))
        return tuple(flown(field.grid, np.array(trace.cells), np.array(trace.captured)) for trace in swarm.traces)


def ours() -> tuple[Ours, ...]:
    """The default, and what is left of it without its parts."""
    return (
        Ours(),
        Ours("belief, random moves", wanders=True),
        Ours("belief, doubt only", DOUBT_ONLY),
    )

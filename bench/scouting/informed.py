"""The planned swarm with something known beforehand, flown as far as it is compared."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.scouting.campaign import known
from bench.scouting.fields import Field
from bench.scouting.flight import ENERGY, Flights, flown, thorough_j
from bench.scouting.judge import CHECKPOINTS, How, along
from fleet.functions.belief import Belief
from fleet.functions.kriging import Variogram, fit, places_of
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import Tactics

Values = NDArray[np.float64]
ENERGIES = (0.2, 0.3, 0.4, 0.5, 0.6)
"""E at which accuracy is compared."""
HOWS = (How.KR, How.LIKELY)
_FARTHEST = ENERGIES[-1] + 0.03
NOTHING = Tactics()


@dataclass(frozen=True)
class Prior:
    """What is believed of a field before anything is captured.

    Args:
        length, nugget: Of the variogram, as in `Variogram`.
        captures: How many captures the variogram weighs as much as: 0 for none, infinite for one that is kept.
        mean: What classes refer to; None for the mean of the map.
    """

    length: float = 1.0
    nugget: float = 0.0
    captures: float = 0.0
    mean: float | None = None


class InformedBelief(Belief):
    """A belief with a prior, which fades as captures come in."""

    def __init__(self, place: Field, prior: Prior) -> None:
        super().__init__(place.grid)
        self._prior = prior

    @property
    def class_mean(self) -> float:
        """The mean that is known, or that of the map."""
        return super().class_mean if self._prior.mean is None else self._prior.mean

    def _fit(self) -> int:
        changed = super()._fit()
        prior, own = self._prior, self._variogram
        if prior.captures and own.variance:
            share = 1.0 if math.isinf(prior.captures) else prior.captures / (prior.captures + self.captured)
            length = prior.length**share * own.length ** (1.0 - share)
            self._variogram = Variogram(length, share * prior.nugget + (1.0 - share) * own.nugget, own.variance)
            self.state = self.state._replace(places=places_of(self._grid, self._variogram))
        return changed


@dataclass(frozen=True)
class Mission:
    """One mission of the planned swarm.

    Args:
        field: Name of the field.
        agents, seed: How many fly, and where they take off.
        tactics, prior: What the swarm was told beforehand.
    """

    field: str
    agents: int
    seed: int
    tactics: Tactics = NOTHING
    prior: Prior = Prior()


def scouted(mission: Mission, before: Callable[[Swarm, int], None] | None = None) -> Flights:
    """Fly until somewhat more energy is spent than is compared.

    Args:
        before: Told the swarm and the cell before each capture.
    """
    place = known(mission.field, 0)
    belief = Belief(place.grid) if mission.prior == Prior() else InformedBelief(place, mission.prior)
    swarm = Swarm(belief, ENERGY, scattered(place.grid, mission.agents, mission.seed), mission.tactics)
    limit_j = _FARTHEST * thorough_j(place, mission.agents)

    def sense(cell: int) -> float:
        if before is not None:
            before(swarm, cell)
        return float(place.truth[cell])

    swarm.fly(sense, watch=lambda: swarm.spent_j > limit_j)
    return tuple(flown(place.grid, np.array(trace.cells), np.array(trace.captured)) for trace in swarm.traces)


def accuracy(mission: Mission) -> Values:
    """Accuracy for each of HOWS at ENERGIES, float64 [hows, energies]."""
    curve = along(known(mission.field, 0), scouted(mission), HOWS)
    at = [int(np.argmin(np.abs(CHECKPOINTS - energy))) for energy in ENERGIES]
    return np.array([curve.accuracy[how][at] for how in HOWS])


def variogram_of(name: str) -> Variogram:
    """The variogram of a whole field."""
    place = known(name, 0)
    return fit(place.truth.reshape(place.grid.valid.shape), place.grid.valid, place.grid)

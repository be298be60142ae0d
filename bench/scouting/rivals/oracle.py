"""A plan that knows the truth: it captures only cells whose class would be wrong on the map, and tours them well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from bench.scouting.fields import Field
from bench.scouting.flight import Flights
from bench.scouting.rivals.greedy import mistakes
from bench.scouting.rivals.tours import LADDER, visit
from fleet.functions.classes import CLASS_THRESHOLDS, class_mean, classes

_ROUNDS = 200
"""After each of so many parts of the cells the map is made anew."""


@dataclass(frozen=True)
class OracleTour:
    """Cells that are wrong on the map, and a tour; the least cells that we know of, not the least energy."""

    name: str = "oracle + tour"

    def budgets(self, place: Field) -> Sequence[float]:
        """Steps of 2 % of the cells."""
        return LADDER

    def fly(self, place: Field, agents: int, seed: int, budget: float | None) -> Flights:
        """Fly to a share of the cells, to all when there is no budget."""
        count = max(agents, round((1.0 if budget is None else budget) * len(place.cells)))
        return visit(place, _wrong_first(place, seed)[:count], agents, whole_path=False)


@lru_cache(maxsize=4)
def _wrong_first(place: Field, seed: int) -> NDArray[np.int64]:
    """All cells in the order in which the oracle wants them: each time some that are wrong on the map."""
    generator = np.random.default_rng(seed)
    order = [generator.choice(place.cells, max(4, len(place.cells) // _ROUNDS), replace=False)]
    captured = np.zeros(place.grid.cells, dtype=np.bool_)
    while True:
        captured[order[-1]] = True
        left = place.cells[~captured[place.cells]]
        if not len(left):
            return np.concatenate(order)
        order.append(_most_alike(place, mistakes(place, captured, ~captured) > 0, left, generator))


def _most_alike(
    place: Field, wrong: NDArray[np.bool_], left: NDArray[np.int64], generator: np.random.Generator
) -> NDArray[np.int64]:
    """Some of the wrong cells that are left: those with the most wrong cells of the same class around them."""
    true = classes(place.truth.reshape(wrong.shape), class_mean(place.truth, place.environment))
    alike = np.zeros(wrong.shape)
    for kind in range(len(CLASS_THRESHOLDS) + 1):
        these = wrong & (true == kind)
        alike += np.where(these, uniform_filter(these.astype(np.float64), 5, mode="constant"), 0.0)
    score = alike.reshape(-1)[left] + 1e-6 * generator.random(len(left))
    return left[np.argsort(-score)[: len(place.cells) // _ROUNDS + 1]]

"""How good the map is for the energy that was spent.

All agents fly at the same time. At any moment the map is made from what all of them have captured so far, and the
energy is what all of them have spent so far, take-offs and landings included, as a share E of visiting and capturing
every cell (`flight.thorough_j`). A curve has a plan's accuracy at every whole percent of E. A plan that flies on to the
end is judged all along its way; a plan with budgets at the end of a mission for each of them, and between those E by
straight lines.

A goal is reached where the mean of three neighbouring points of the curve first meets it, between points by a straight
line. So one lucky point is not enough, and no plan is made later or earlier on average.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from bench.scouting.fields import Field
from bench.scouting.flight import Flights, thorough_j
from bench.scouting.plans import Plan
from fleet.functions.classes import class_mean, classes, likely_values
from fleet.functions.evaluation import truth_metrics
from fleet.functions.extrapolation import neighbour_mean
from fleet.functions.kriging import krige

Values = NDArray[np.float64]
CHECKPOINTS: Values = np.arange(2, 131) / 100.0
"""E at which curves are known."""


class How(StrEnum):
    """From captured cells to a map of classes."""

    NM = "nm"
    """The paper's neighbour mean."""
    KR = "kr"
    """Kriging; the class of the expected value."""
    LIKELY = "likely"
    """Kriging; the most probable class."""
    KR_OWN = "kr-own"
    """As `KR`, but the map's classes refer to its own mean, as in flight, where nobody knows the true one."""
    LIKELY_OWN = "likely-own"
    """As `LIKELY`, likewise."""


ALL = tuple(How)


@dataclass(frozen=True, eq=False)
class Curve:
    """What a plan reaches on a field.

    Args:
        cells: Share of the cells that are captured, float64 [K], at CHECKPOINTS; NaN below the first that is known.
        accuracy: Share of the cells whose class is right, likewise, for each way to extrapolate.
        ended: E at the end of the mission, of the largest budget.
        time_s: How long the slowest agent flew, likewise.
        balance: Slowest over mean flight; with budgets the mean over them.
    """

    cells: Values
    accuracy: dict[How, Values]
    ended: float
    time_s: float
    balance: float

    def reached(self, goal: float, how: How) -> tuple[float, float]:
        """E and share of the cells at which a goal is reached; NaN when it is not."""
        smooth = _smoothed(self.accuracy[how])
        meets = np.flatnonzero(smooth >= goal)
        if not len(meets):
            return float("nan"), float("nan")
        at = float(meets[0])
        before = smooth[meets[0] - 1] if meets[0] else np.nan
        if np.isfinite(before):
            at -= (smooth[meets[0]] - goal) / (smooth[meets[0]] - before)
        points = np.arange(len(CHECKPOINTS))
        return float(np.interp(at, points, CHECKPOINTS)), float(np.interp(at, points, self.cells))

    def at_cells(self, share: float, how: How) -> float:
        """Accuracy where a share of the cells has been captured; NaN when it never was."""
        known = np.isfinite(self.cells)
        if not known.any() or self.cells[known][-1] < share:
            return float("nan")
        rising = np.maximum.accumulate(self.cells[known])
        return float(np.interp(share, rising, self.accuracy[how][known]))


def judged(plan: Plan, field: Field, agents: int, seed: int, hows: Sequence[How] = ALL) -> Curve:
    """Fly a plan with one seed, and judge it."""
    budgets = plan.budgets(field)
    if not budgets:
        return along(field, plan.fly(field, agents, seed, None), hows)
    return over_budgets(field, [plan.fly(field, agents, seed, budget) for budget in budgets], hows)


def along(field: Field, flights: Flights, hows: Sequence[How] = ALL) -> Curve:
    """The curve of one mission, all along its way."""
    energy, cells = progress(field, flights)
    captured = np.zeros(field.grid.cells, dtype=np.bool_)
    done = 0
    figures: list[list[float]] = []
    for checkpoint in CHECKPOINTS:
        now = int(np.searchsorted(energy, checkpoint + 1e-12, side="right"))
        if now > done or not figures:
            captured[cells[done:now][cells[done:now] >= 0]] = True
            done = now
            figures.append(_figures(field, captured, hows))
        else:
            figures.append(figures[-1])
    table = np.array(figures)
    accuracy = {how: table[:, index + 1] for index, how in enumerate(hows)}
    slowest, balance = times_of(flights)
    return Curve(table[:, 0], accuracy, float(energy[-1]), slowest, balance)


def over_budgets(field: Field, missions: Sequence[Flights], hows: Sequence[How] = ALL) -> Curve:
    """The curve of missions with ever larger budgets, each judged at its end."""
    ends, figures = [], []
    for flights in missions:
        captured = np.zeros(field.grid.cells, dtype=np.bool_)
        for flight in flights:
            captured[flight.cells[flight.captured]] = True
        ends.append(sum(flight.total_j for flight in flights) / thorough_j(field, len(flights)))
        figures.append(_figures(field, captured, hows))
    order = np.argsort(ends, kind="stable")
    at, table = np.array(ends)[order], np.array(figures)[order]
    columns = [np.interp(CHECKPOINTS, at, column, left=np.nan) for column in table.T]
    times = [times_of(flights) for flights in missions]
    accuracy = {how: columns[index + 1] for index, how in enumerate(hows)}
    return Curve(columns[0], accuracy, float(at[-1]), times[-1][0], float(np.mean([each[1] for each in times])))


def progress(field: Field, flights: Flights) -> tuple[Values, NDArray[np.int64]]:
    """Everything that happens in a mission, in the order of time.

    Returns:
        E after each visit of a cell, float64 [V], ascending; and the cell when it was captured, else -1, int64 [V].
    """
    time_s = np.concatenate([flight.time_s for flight in flights])
    spent_j = np.concatenate([np.diff(flight.energy_j, prepend=0.0) for flight in flights])
    cells = np.concatenate([np.where(flight.captured, flight.cells, -1) for flight in flights])
    order = np.argsort(time_s, kind="stable")
    landing_j = sum(flight.landing_j for flight in flights)
    return (landing_j + np.cumsum(spent_j[order])) / thorough_j(field, len(flights)), cells[order]


def accuracies(field: Field, captured: NDArray[np.bool_], hows: Sequence[How] = ALL) -> dict[How, float]:
    """Share of the cells whose class is right when some were captured, bool [cells]; 0 when none was."""
    if not captured.any():
        return dict.fromkeys(hows, 0.0)
    seen, environment = field.seen(captured), field.environment
    found = {}
    if How.NM in hows:
        found[How.NM] = truth_metrics(neighbour_mean(seen, field.grid), environment)["accuracy"]
    if {How.KR, How.LIKELY, How.KR_OWN, How.LIKELY_OWN} & set(hows):
        prediction = krige(seen, field.grid)
        true, own = class_mean(prediction.values, environment), float(np.nanmean(prediction.values))
        for mean, expected, probable in ((true, How.KR, How.LIKELY), (own, How.KR_OWN, How.LIKELY_OWN)):
            found[expected] = _right(field, classes(prediction.values, mean))
            found[probable] = _right(field, classes(likely_values(prediction, mean), mean))
    return {how: found[how] for how in hows}


def _right(field: Field, predicted: Values) -> float:
    """Share of the cells whose class is the true one; the true classes refer to the true mean."""
    truth = field.truth.reshape(predicted.shape)
    right = predicted == classes(truth, class_mean(truth, field.environment))
    return float(right[field.grid.valid].mean())


def _figures(field: Field, captured: NDArray[np.bool_], hows: Sequence[How]) -> list[float]:
    found = accuracies(field, captured, hows)
    return [float(np.count_nonzero(captured)) / len(field.cells), *(found[how] for how in hows)]


def times_of(flights: Flights) -> tuple[float, float]:
    """Time of the slowest flight, and that over the mean."""
    times = [flight.total_s for flight in flights]
    return max(times), max(times) / float(np.mean(times)) if max(times) else 1.0


def _smoothed(values: Values) -> Values:
    """Mean of each value and its neighbours that are known; NaN stays NaN."""
    padded = np.pad(values, 1, constant_values=np.nan)
    triples = np.stack((padded[:-2], padded[1:-1], padded[2:]))
    known = np.isfinite(triples)
    mean = np.where(known, triples, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return np.where(np.isfinite(values), mean, np.nan)

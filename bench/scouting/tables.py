"""Tables of what the plans reached."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from bench.scouting.baselines import published
from bench.scouting.campaign import Curves
from bench.scouting.fields import AIMED
from bench.scouting.judge import CHECKPOINTS, Curve, How
from bench.statistics import paired

GOALS = (0.7, 0.8, 0.9)
ENERGIES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
MEAN = "mean of 4"


def plan_names(curves: Curves) -> list[str]:
    """Plans in the order of the jobs."""
    return list(dict.fromkeys(job.plan for job in curves))


def field_names(curves: Curves) -> list[str]:
    """Fields in the order of the jobs."""
    return list(dict.fromkeys(job.field for job in curves))


def of(curves: Curves, plan: str, place: str) -> list[Curve]:
    """A plan's curves on a field, by seed."""
    return [curve for job, curve in curves.items() if job.plan == plan and job.field == place]


def to_goals(curves: Curves, place: str, how: How) -> Table:
    """Cells and energy that each plan needs on a field, mean over the seeds, beside what was published."""
    table = Table(
        "plan", "cells 70/80/90", "published", "E 70/80/90", "published ", "slowest/mean", title=f"{place}, {how}"
    )
    for plan in plan_names(curves):
        flights = of(curves, plan, place)
        energy, cells = (needed(flights, how, part) for part in (0, 1))
        known = published(plan, place) if how is How.KR else ("", "")
        balance = f"{np.mean([curve.balance for curve in flights]):.2f}"
        table.add_row(plan, _percent(cells), known[0], _percent(energy), known[1], balance)
    return table


def needed(flights: Sequence[Curve], how: How, part: int) -> list[float]:
    """Mean over the seeds of E (part 0) or cells (1) to each goal; NaN where one seed does not reach it."""
    return [float(np.mean([curve.reached(goal, how)[part] for curve in flights])) for goal in GOALS]


def means(curves: Curves, how: How) -> Table:
    """Energy that each plan needs in the mean of the fields of the aims, and accuracy at equal energy."""
    columns = [f"E {goal:.0%}" for goal in GOALS] + [f"at {energy:.0%}" for energy in ENERGIES]
    table = Table("plan", *columns, title=f"{MEAN}, {how}: E to a goal; accuracy at E")
    for plan in plan_names(curves):
        energies = np.mean([needed(of(curves, plan, place), how, 0) for place in AIMED], axis=0)
        accuracy = [float(np.mean(at_energy(curves, plan, AIMED, energy, how))) for energy in ENERGIES]
        table.add_row(plan, *(f"{100 * figure:.1f}" for figure in (*energies, *accuracy)))
    return table


def at_energy(curves: Curves, plan: str, places: Sequence[str], energy: float, how: How) -> NDArray[np.float64]:
    """A plan's accuracy at E for each seed, the mean over some fields, float64 [seeds], which are what is drawn."""
    at = int(np.argmin(np.abs(CHECKPOINTS - energy)))
    rows = [[curve.accuracy[how][at] for curve in of(curves, plan, place)] for place in places]
    return np.asarray(np.mean(rows, axis=0), dtype=np.float64)


def differences(curves: Curves, against: str, places: Sequence[str], how: How) -> Table:
    """Accuracy of each plan minus another's at equal energy, with 95 % intervals, in points."""
    table = Table("plan", *(f"at {energy:.0%}" for energy in ENERGIES), title=f"minus {against}, {how}, points")
    for plan in plan_names(curves):
        if plan != against:
            pairs = [[at_energy(curves, name, places, energy, how) for name in (plan, against)] for energy in ENERGIES]
            table.add_row(plan, *(points(ours, theirs) for ours, theirs in pairs))
    return table


def points(ours: NDArray[np.float64], theirs: NDArray[np.float64]) -> str:
    """Ours minus theirs in points with its interval; empty unless both have a figure for every seed."""
    found = paired(ours, theirs)
    if found.pairs < len(ours):
        return ""
    return f"{100 * found.mean:+.1f} [{100 * found.low:+.1f}, {100 * found.high:+.1f}]"


def _percent(figures: Sequence[float]) -> str:
    return "/".join(f"{100 * figure:.0f}" if np.isfinite(figure) else "-" for figure in figures)

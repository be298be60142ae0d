"""The comparisons that count: with the best rival of each field at equal energy, and with a lattice at equal cells."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from bench.scouting.campaign import Curves
from bench.scouting.judge import How
from bench.scouting.ours import ours
from bench.scouting.tables import at_energy, field_names, needed, of, plan_names, points

BEST_OF = ("transects, rows", "transects, columns", "GP over its path")
"""Whoever is better than the best of these on every field is worth flying."""
LATTICE = "lattice + tour"
GOALS = (0.7, 0.8)
SHARES = (0.26, 0.4, 0.5)


def best_rival(curves: Curves, place: str, goal: int, how: How) -> tuple[str, float]:
    """The rival that reaches a goal of GOALS on a field with the least energy, and that energy; NaN when none does."""
    energies = {name: needed(of(curves, name, place), how, 0)[goal] for name in BEST_OF if name in plan_names(curves)}
    reached = {name: energy for name, energy in energies.items() if np.isfinite(energy)}
    best = min(reached, key=lambda name: reached[name], default="")
    return best, reached.get(best, float("nan"))


def against_best(curves: Curves, how: How) -> Table:
    """Accuracy of our plans minus the best rival's, in points, at the energy with which that one reaches the goal.

    Of every other plan too where none of ours was flown.
    """
    names = plan_names(curves)
    shown = [plan.name for plan in ours() if plan.name in names] or names
    title = f"minus the best of {', '.join(BEST_OF)}, at its E; {how}, points"
    table = Table("field", "goal", "best", "its E", *shown, title=title)
    for place, goal in product(field_names(curves), range(len(GOALS))):
        rival, energy = best_rival(curves, place, goal, how)
        if rival:
            theirs = at_energy(curves, rival, [place], energy, how)
            row = [
                points(at_energy(curves, plan, [place], energy, how), theirs) if plan != rival else "" for plan in shown
            ]
            table.add_row(place, f"{GOALS[goal]:.0%}", rival, f"{energy:.3f}", *row)
    return table


def at_equal_cells(curves: Curves, how: How) -> Table:
    """Accuracy of each plan minus the lattice's where both have as many cells, mean of the fields, in points."""

    def gap(plan: str, share: float) -> str:
        return points(at_share(curves, plan, share, how), at_share(curves, LATTICE, share, how))

    others = [plan for plan in plan_names(curves) if plan != LATTICE]
    rows = {plan: [gap(plan, share) for share in SHARES] for plan in others}
    return _table(f"minus {LATTICE} at equal cells; {how}, points", [f"at {share:.0%}" for share in SHARES], rows)


def at_share(curves: Curves, plan: str, share: float, how: How) -> NDArray[np.float64]:
    """A plan's accuracy where it has captured a share of the cells, mean of the fields, float64 [seeds]."""
    rows = [[curve.at_cells(share, how) for curve in of(curves, plan, place)] for place in field_names(curves)]
    return np.asarray(np.mean(rows, axis=0), dtype=np.float64)


def of_fields(curves: Curves, wanted: Sequence[str]) -> Curves:
    """The curves of some fields."""
    return {job: curve for job, curve in curves.items() if job.field in wanted}


def _table(title: str, columns: list[str], rows: dict[str, list[str]]) -> Table:
    table = Table("plan", *columns, title=title)
    for plan, found in rows.items():
        table.add_row(plan, *found)
    return table

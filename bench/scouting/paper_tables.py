"""Tables of what the paper's swarm and its parts reached."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.scouting.fields import averaged_over
from bench.scouting.judge import How
from bench.scouting.scaffold import WEIGHED_AT, Arm
from bench.statistics import paired

if TYPE_CHECKING:
    from bench.scouting.paper import Results

Values = NDArray[np.float64]
COMPARED = ("nm", "kr", "energy")


def show(results: Results, console: Console) -> None:
    """Print every table."""
    for how in results.hows:
        shaped = results.shaped_by(how)
        aims = shaped.on(averaged_over(shaped.fields))
        for goal in shaped.goals:
            sizes = shaped.to(goal).sizes
            for size in sizes:
                console.print(of_arms(aims, goal, size))
            console.print(of_fields(shaped, goal, WEIGHED_AT if WEIGHED_AT in sizes else sizes[-1]))
            if len(sizes) > 1:
                console.print(of_sizes(shaped.to(goal), goal))


def of_arms(results: Results, goal: float, agents: int) -> Table:
    """What each arm reached at its end, and its difference to the paper's, in the mean over the fields."""
    how, over = results.hows[0], len(results.fields)
    table = Table(
        "arm", "accuracy nm/kr", "goal met", "cells", "E", "time, s", "slowest/mean", "nm - paper's, points",
        "kr - paper's, points", "E - paper's, hundredths",
        title=f"shaped by {how}: goal {goal:.0%}, {agents} agents, mean of {over}",
    )  # fmt: skip
    for arm in results.flown(agents):
        nm, kr, cells, energy, time_s, balance = (
            results.figures(arm, goal, agents, name) for name in ("nm", "kr", "cells", "energy", "time_s", "balance")
        )
        table.add_row(
            arm.value,
            f"{100 * nm.mean():.1f} / {100 * kr.mean():.1f}",
            f"{((nm if how is How.NM else kr) >= goal).mean():.0%}",
            f"{cells.mean():.0%}",
            f"{energy.mean():.3f}",
            f"{time_s.mean():.0f}",
            f"{balance.mean():.2f}",
            *("" if arm is Arm.PAPER else difference(results, arm, (goal, agents), name) for name in COMPARED),
        )
    return table


def difference(results: Results, arm: Arm, case: tuple[float, int], figure: str) -> str:
    """A figure of an arm minus the paper's, of a (goal, agents), mean over the fields, in hundredths with interval."""
    ours, theirs = (results.figures(each, *case, figure).mean(axis=0) for each in (arm, Arm.PAPER))
    found = paired(ours, theirs)
    return f"{100 * found.mean:+.1f} [{100 * found.low:+.1f}, {100 * found.high:+.1f}]"


def of_fields(results: Results, goal: float, agents: int) -> Table:
    """What the paper's swarm reached on each field, and what the arms did there minus that."""
    how = results.hows[0]
    others = [arm for arm in results.flown(agents) if arm not in (Arm.PAPER, Arm.NO_SHAPING)]
    columns = [f"{arm.value.split(',')[0]} - paper's: {figure}" for arm in others for figure in (how.value, "E")]
    title = f"shaped by {how}: goal {goal:.0%}, {agents} agents, each field"
    table = Table("field", "accuracy nm/kr", "goal met", "cells", "E", *columns, title=title)
    for name in results.fields:
        mine = results.on([name])
        nm, kr, cells, energy = (
            mine.figures(Arm.PAPER, goal, agents, each) for each in ("nm", "kr", "cells", "energy")
        )
        table.add_row(
            name,
            f"{100 * nm.mean():.1f} / {100 * kr.mean():.1f}",
            f"{((nm if how is How.NM else kr) >= goal).mean():.0%}",
            f"{cells.mean():.0%}",
            f"{energy.mean():.3f}",
            *(difference(mine, arm, (goal, agents), figure) for arm in others for figure in (how.value, "energy")),
        )
    return table


def of_sizes(results: Results, goal: float) -> Table:
    """One agent's time and energy over those of several, of the paper's swarm, mean over the fields of the aims."""
    over = averaged_over(results.fields)
    title = f"shaped by {results.hows[0]}: goal {goal:.0%}, 1 agent over several, mean of {len(over)}; and each field"
    columns = ("agents", "sooner", "energy", "slowest/mean", "accuracy nm")
    table = Table(*columns, *(f"{name}: sooner" for name in results.fields), title=title)
    rows = [results.fields.index(name) for name in over]
    one_s, one_e = (_of_fields(results, goal, results.sizes[0], name) for name in ("time_s", "energy"))
    for size in results.sizes:
        time_s, energy, balance, nm = (
            _of_fields(results, goal, size, name) for name in ("time_s", "energy", "balance", "nm")
        )
        sooner = one_s / time_s
        table.add_row(
            str(size), f"{sooner[rows].mean():.2f}", f"{(energy / one_e)[rows].mean():.2f}",
            f"{balance[rows].mean():.2f}", f"{100 * nm[rows].mean():.1f}", *(f"{each:.2f}" for each in sooner),
        )  # fmt: skip
    return table


def _of_fields(results: Results, goal: float, agents: int, figure: str) -> Values:
    """A figure of the paper's swarm, mean over the seeds, float64 [fields]."""
    return np.asarray(results.figures(Arm.PAPER, goal, agents, figure).mean(axis=1))

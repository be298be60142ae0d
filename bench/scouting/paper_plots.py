"""A picture of the paper's swarm and its parts: accuracy over energy, and how much sooner more agents are done."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.scouting.fields import averaged_over
from bench.scouting.judge import How
from bench.scouting.scaffold import WEIGHED_AT, Arm

if TYPE_CHECKING:
    from bench.scouting.paper import Results

_PANEL_INCHES = (4.6, 4.0)
_MARKS = {
    Arm.PAPER: "o-", Arm.RANDOM_MOVES: "s--", Arm.FIXED_V: "x:", Arm.EQUAL_WEIGHTS: "^-.", Arm.NO_SHAPING: "D",
}  # fmt: skip


def draw(results: Results, path: Path) -> None:
    """Write the picture; the ending of its path says of what kind."""
    picture(results).savefig(path, dpi=110)


def picture(results: Results) -> Figure:
    """Means over the fields of the aims and over the seeds: one panel for each kind of map, and one for the sizes."""
    aims = results.on(averaged_over(results.fields))
    panels = len(aims.hows) + 1
    figure = Figure((_PANEL_INCHES[0] * panels, _PANEL_INCHES[1] + 0.9), layout="constrained")
    axes = figure.subplots(1, panels, squeeze=False)[0]
    for panel, how in zip(axes, aims.hows, strict=False):
        _arms(panel, aims.shaped_by(how), how)
    _sizes(axes[-1], aims.shaped_by(aims.hows[0]))
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower left", ncols=3, fontsize="small")
    return figure


def _arms(panel: Axes, shaped: Results, how: How) -> None:
    """Where the missions of each arm ended, one mark a goal."""
    agents = WEIGHED_AT if WEIGHED_AT in shaped.sizes else shaped.sizes[-1]
    for arm in shaped.flown(agents):
        energy, accuracy = (
            [100 * shaped.figures(arm, goal, agents, name).mean() for goal in shaped.goals]
            for name in ("energy", how.value)
        )
        panel.plot(energy, accuracy, _MARKS[arm], label=arm.value, lw=1.2, ms=5)
    for goal in shaped.goals:
        panel.axhline(100 * goal, color="0.8", lw=0.8, zorder=0)
    panel.set(title=f"shaped by {how}, {agents} agents", xlabel="energy, % of visiting every cell")
    panel.set_ylabel(f"right classes, % ({how})")


def _sizes(panel: Axes, shaped: Results) -> None:
    """Time of the fewest agents over that of more, one line a goal."""
    sizes = np.array(shaped.sizes)
    for goal in (goal for goal in shaped.goals if shaped.to(goal).sizes == shaped.sizes):
        times = [shaped.figures(Arm.PAPER, goal, size, "time_s").mean(axis=1) for size in shaped.sizes]
        panel.plot(sizes, [(times[0] / each).mean() for each in times], "o-", label=f"goal {goal:.0%}", lw=1.2, ms=5)
    panel.plot(sizes, sizes / sizes[0], "--", color="0.6", lw=1.0, label="as many times as agents")
    panel.set(title=f"shaped by {shaped.hows[0]}, paper's swarm", xlabel="agents", xticks=shaped.sizes)
    panel.set_ylabel(f"mission time: {shaped.sizes[0]} over so many, times")
    panel.legend(fontsize="small")

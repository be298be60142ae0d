"""Pictures of the curves: accuracy over energy, one panel a field, one line a plan."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bench.scouting.campaign import Curves
from bench.scouting.judge import CHECKPOINTS, How
from bench.scouting.tables import GOALS, field_names, of, plan_names

_ACROSS = 3
_PANEL_INCHES = (5.0, 4.0)
_DASHES = ("-", "--", ":")


def draw(curves: Curves, how: How, path: Path) -> None:
    """Write a picture of every plan on every field, means over the seeds.

    Args:
        path: Where to; its ending says the kind of picture.
    """
    places, plans = field_names(curves), plan_names(curves)
    across = min(_ACROSS, len(places))
    down = -(-len(places) // across)
    figure = Figure((_PANEL_INCHES[0] * across, _PANEL_INCHES[1] * down + 1.0), layout="constrained")
    panels = figure.subplots(down, across, squeeze=False, sharex=True, sharey=True)
    for panel, place in zip(panels.flat, places, strict=False):
        for number, plan in enumerate(plans):
            mean = np.mean([curve.accuracy[how] for curve in of(curves, plan, place)], axis=0)
            panel.plot(100 * CHECKPOINTS, 100 * mean, _DASHES[number // 10 % len(_DASHES)], label=plan, lw=1.2)
        for goal in GOALS:
            panel.axhline(100 * goal, color="0.8", lw=0.8, zorder=0)
        panel.set(title=place, xlim=(0, 110), ylim=(40, 101), xlabel="energy, % of visiting every cell")
        panel.set_ylabel(f"right classes, % ({how})")
    for panel in panels.flat[len(places) :]:
        panel.set_axis_off()
    figure.legend(*panels.flat[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize="small")
    figure.savefig(path)

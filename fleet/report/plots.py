"""The report's pictures; the one door to matplotlib.

Maps have north at the top and east at the right whatever the context's rows and columns do; their axes are labelled
with rows and columns of the context. Colours can be told apart by people with colour-blindness: viridis for values,
purple to orange for errors, the palette of Okabe and Ito for agents. Equal input gives equal bytes.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, Colormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from fleet.contexts.grid import Grid
from fleet.report.figures import VALUES, Cloud, Line, Scale, Series, Track, spread

TRUTH_BELOW_PATHS = "Greys"
NO_DATA = "#e4e4e7"
INK = "#27272a"
AGENTS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442")
"""Okabe and Ito: Color Universal Design, 2008."""
_STYLE: Any = {
    "font.family": "DejaVu Sans", "font.size": 9, "axes.titlesize": 9, "axes.labelsize": 8, "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5, "legend.fontsize": 8, "axes.edgecolor": "#a1a1aa", "axes.linewidth": 0.8,
    "axes.labelcolor": INK, "xtick.color": "#71717a", "ytick.color": "#71717a", "xtick.labelcolor": INK,
    "ytick.labelcolor": INK, "text.color": INK, "axes.spines.top": False, "axes.spines.right": False,
    "figure.facecolor": "white", "savefig.facecolor": "white",
}  # fmt: skip
_DPI = 144
_LEGEND_LIMIT, _LEGEND_COLUMNS = 12, 4
_MAP_WIDTH, _MAP_HEIGHT = 3.4, 4.6
_LEFT, _RIGHT, _BELOW, _ABOVE, _LEGEND_ROW = 0.52, 0.95, 0.5, 0.24, 0.22
"""Inches: greatest size of a map, and room around it."""


def value_map(grid: Grid, values: NDArray[np.float64], scale: Scale) -> bytes:
    """A PNG of numbers on the grid; cells that are NaN are grey."""
    with mpl.rc_context(_STYLE):
        figure, axes, beside = _map_figure(grid)
        colours, norm, ticks = _colours(scale)
        image = axes.imshow(values, cmap=colours, norm=norm, interpolation="nearest", aspect="auto")
        _orient(axes, grid)
        extend = "neither" if scale.steps else _extend(values, scale)
        bar = figure.colorbar(image, cax=beside, extend=extend, ticks=ticks)
        bar.set_label(scale.label)
        bar.outline.set_visible(False)
        return _png(figure)


def path_map(grid: Grid, background: NDArray[np.float64] | None, tracks: Sequence[Track]) -> bytes:
    """A PNG of each agent's way over the grid: a disc where it took off, a cross where it ended."""
    with mpl.rc_context(_STYLE):
        figure, axes, beside = _map_figure(grid, legend_rows=_legend_rows(len(tracks)))
        beside.remove()
        below = np.where(grid.valid, 1.0, np.nan) if background is None else background
        colours, norm, _ = _colours(Scale("", *_faint(below), TRUTH_BELOW_PATHS))
        colours = colours.with_extremes(bad="white")
        axes.imshow(below, cmap=colours, norm=norm, interpolation="nearest", aspect="auto")
        for index, track in enumerate(tracks):
            _draw_track(axes, track, index)
        _orient(axes, grid)
        if _legend_rows(len(tracks)):
            figure.legend(loc="lower center", ncols=_LEGEND_COLUMNS, frameon=False, handlelength=1.4, columnspacing=1.2)
        return _png(figure)


def metric_over_missions(series: Series) -> bytes:
    """A PNG of one metric, from 0 so that small changes look small; goals are dashed lines."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(3.1, 1.95), layout="constrained")
        axes = figure.add_subplot()
        axes.plot(series.missions, series.values, "o-", color=AGENTS[0], lw=1.4, ms=4, clip_on=False, zorder=3)
        _label_values(axes, series)
        _draw_goals(axes, series)
        axes.set_title(series.label)
        _from_zero(axes, series)
        axes.xaxis.set_major_locator(MaxNLocator(nbins=6, integer=True))
        axes.yaxis.set_major_locator(MaxNLocator(nbins=4))
        axes.grid(axis="y", color=NO_DATA, lw=0.6)
        axes.set_axisbelow(True)
        axes.set_xlabel("mission")
        return _png(figure)


def models_over_missions(
    models: Sequence[str], usefulness: Mapping[int, Sequence[float]], levels: Mapping[int, Sequence[float]]
) -> bytes:
    """A PNG of tables in colour: usefulness and level of each model.

    Args:
        models: Names of the rows.
        usefulness: By the mission that flies with the models: one number a model, NaN when it has not flown.
        levels: By the mission after which models were retrained: one level a model, NaN when there is none.
    """
    tables = [("usefulness", "for mission", usefulness, Normalize(0, _top(usefulness)), "{:.2f}"),
              ("level of its aggregator", "after mission", levels, Normalize(0, 9), "{:.0f}")]  # fmt: skip
    tables = [table for table in tables if table[2]]
    widths = [len(table[2]) for table in tables]
    with mpl.rc_context(_STYLE):
        size = (1.6 + sum(max(1.6, min(5.0, 0.42 * width)) for width in widths), 1.1 + 0.24 * len(models))
        figure = Figure(figsize=size, layout="constrained")
        panels = figure.subplots(1, len(tables), squeeze=False, sharey=True, width_ratios=[max(4, w) for w in widths])
        for axes, (title, along, columns, norm, form) in zip(panels[0], tables, strict=True):
            _draw_table(axes, columns, norm, form)
            axes.set_title(title)
            axes.set_xlabel(along)
        panels[0][0].set_yticks(range(len(models)), models)
        return _png(figure)


def reward_weights(features: Sequence[str], weights: Sequence[float]) -> bytes:
    """A PNG with one bar a feature."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(4.6, 0.7 + 0.3 * len(features)), layout="constrained")
        axes = figure.add_subplot()
        bars = axes.barh(range(len(features)), weights, color=AGENTS[0], height=0.62)
        axes.bar_label(bars, labels=[f"{weight:.2f}" for weight in weights], padding=3, fontsize=8)
        axes.set_yticks(range(len(features)), features)
        axes.set_xlim(0, max(1.0, *weights) * 1.1)
        axes.invert_yaxis()
        axes.set_xlabel("weight in the reward")
        return _png(figure)


def trial_cloud(cloud: Cloud) -> bytes:
    """A PNG of what the parameter sets of reward shaping came to in simulation."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(4.6, 2.7), layout="constrained")
        axes = figure.add_subplot()
        x, y, met = np.array(cloud.x), np.array(cloud.y), np.array(cloud.met, dtype=np.bool_)
        axes.scatter(x[~met], y[~met], s=20, facecolors="none", edgecolors=AGENTS[1], label="missed a goal")
        axes.scatter(x[met], y[met], s=20, color=AGENTS[0], label="met every goal")
        if cloud.chosen is not None:
            at = (x[cloud.chosen], y[cloud.chosen])
            axes.scatter(*at, s=110, facecolors="none", edgecolors=INK, lw=1.3, label="chosen", zorder=4)
        if cloud.at_least is not None:
            axes.axhline(cloud.at_least, color=AGENTS[1], lw=1.0, ls="--", zorder=0)
        axes.set_xlabel(cloud.x_label)
        axes.set_ylabel(cloud.y_label)
        axes.margins(0.08)
        axes.grid(color=NO_DATA, lw=0.6)
        axes.set_axisbelow(True)
        figure.legend(loc="outside upper left", ncols=3, frameon=False, handletextpad=0.2)
        return _png(figure)


def accuracy_over_time(lines: Sequence[Line], goal: float) -> bytes:
    """A PNG of accuracies in % over minutes of a mission; the goal is a dotted line."""
    with mpl.rc_context(_STYLE):
        figure, axes = _chart("minutes of the mission", "accuracy (%)")
        for index, line in enumerate(lines):
            axes.plot(line.x, line.y, "--" if line.dashed else "-", color=AGENTS[index], lw=1.4, label=line.label)
        axes.axhline(goal, color=INK, lw=1.0, ls=":", label="goal")
        axes.set_ylim(0, 102)
        figure.legend(loc="outside upper left", ncols=2, frameon=False, handlelength=1.6, columnspacing=1.2)
        return _png(figure)


def calibration(lines: Sequence[Line]) -> bytes:
    """A PNG of how often classes were right that were given some probability; the diagonal is perfect."""
    with mpl.rc_context(_STYLE):
        figure, axes = _chart("probability that was given (%)", "right (%)")
        axes.plot([0, 100], [0, 100], color=NO_DATA, lw=1.4, zorder=0)
        for index, line in enumerate(lines):
            axes.plot(line.x, line.y, "o-", color=AGENTS[index], lw=1.2, ms=4, label=line.label, clip_on=False)
        axes.set_xlim(25, 100)
        axes.set_ylim(0, 102)
        figure.legend(loc="outside upper left", ncols=2, frameon=False, handlelength=1.6, columnspacing=1.2)
        return _png(figure)


def _chart(x_label: str, y_label: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(4.6, 2.9), layout="constrained")
    axes = figure.add_subplot()
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.grid(color=NO_DATA, lw=0.6)
    axes.set_axisbelow(True)
    return figure, axes


def _map_figure(grid: Grid, legend_rows: int = 0) -> tuple[Figure, Axes, Axes]:
    """A figure, the map's axes, and axes for the colours beside it; the map is at the same place in every picture."""
    shape = (grid.rows * grid.cell_height_m) / (grid.columns * grid.cell_width_m)
    width = min(_MAP_WIDTH, _MAP_HEIGHT / shape)
    height = max(width * shape, 0.8)
    below = _BELOW + _LEGEND_ROW * legend_rows
    whole = (_LEFT + _MAP_WIDTH + _RIGHT, below + height + _ABOVE)
    figure = Figure(figsize=whole)
    left, bottom = (_LEFT + (_MAP_WIDTH - width) / 2) / whole[0], below / whole[1]
    axes = figure.add_axes((left, bottom, width / whole[0], height / whole[1]))
    beside = figure.add_axes((left + (width + 0.1) / whole[0], bottom, 0.13 / whole[0], height / whole[1]))
    return figure, axes, beside


def _legend_rows(agents: int) -> int:
    return -(-agents // _LEGEND_COLUMNS) if agents <= _LEGEND_LIMIT else 0


def _orient(axes: Axes, grid: Grid) -> None:
    """North to the top, east to the right, cells in their true proportions."""
    axes.set_xlim(*((-0.5, grid.columns - 0.5) if grid.columns_go_east else (grid.columns - 0.5, -0.5)))
    axes.set_ylim(*((grid.rows - 0.5, -0.5) if grid.rows_go_south else (-0.5, grid.rows - 0.5)))
    axes.set_aspect(grid.cell_height_m / grid.cell_width_m)
    for axis, count, name in ((axes.xaxis, grid.columns, "column"), (axes.yaxis, grid.rows, "row")):
        axis.set_major_locator(MaxNLocator(nbins=min(8, count), integer=True))
        axis.set_label_text(name)
    axes.text(1.0, 1.01, "N \N{UPWARDS ARROW}", transform=axes.transAxes, ha="right", va="bottom", fontsize=7.5)
    axes.spines[:].set_visible(False)


def _colours(scale: Scale) -> tuple[Colormap, Normalize, Sequence[float] | None]:
    if not scale.steps:
        return mpl.colormaps[scale.colours].with_extremes(bad=NO_DATA), Normalize(scale.low, scale.high), None
    classes = np.arange(scale.low, scale.high + 1)
    colours = mpl.colormaps[scale.colours].resampled(max(2, len(classes))).with_extremes(bad=NO_DATA)
    edges = np.append(classes - 0.5, classes[-1] + 0.5)
    return colours, BoundaryNorm(edges, len(classes)) if len(classes) > 1 else Normalize(0, 1), classes.tolist()


def _extend(values: NDArray[np.float64], scale: Scale) -> str:
    found = values[np.isfinite(values)]
    low, high = bool(np.any(found < scale.low)), bool(np.any(found > scale.high))
    return {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[low, high]


def _faint(values: NDArray[np.float64]) -> tuple[float, float]:
    """Limits that keep the greys light, so that the ways stay readable."""
    low, high = spread([values], 1, 99)
    span = (high - low) or 1.0
    return low - 0.15 * span, high + 1.5 * span


def _draw_track(axes: Axes, track: Track, index: int) -> None:
    colour = AGENTS[index % len(AGENTS)]
    dashes = ("-", "--", ":", "-.")[index // len(AGENTS) % 4]
    halo = [Stroke(linewidth=2.6, foreground="white"), Normal()]
    axes.plot(track.columns, track.rows, dashes, color=colour, lw=1.3, label=track.agent, path_effects=halo)
    axes.plot(track.columns[:1], track.rows[:1], "o", color=colour, ms=7, mec="white", mew=1.2, zorder=4)
    axes.plot(track.columns[-1:], track.rows[-1:], "X", color=colour, ms=6.5, mec="white", mew=0.9, zorder=4)


def _from_zero(axes: Axes, series: Series) -> None:
    shown = [*series.values, *(goal for goal in (series.at_least, series.at_most) if goal is not None)]
    low, high = min(0.0, *shown), max(0.0, *shown)
    room = 0.25 * ((high - low) or 1.0)
    axes.set_ylim(low - (room if low < 0 else 0.0), high + room)
    axes.set_xlim(min(series.missions) - 0.4, max(series.missions) + 0.4)


def _label_values(axes: Axes, series: Series) -> None:
    if len(series.missions) > 5:
        return
    for mission, value in zip(series.missions, series.values, strict=True):
        axes.annotate(
            f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}", xy=(mission, value), xytext=(0, 5),
            textcoords="offset points", ha="center", va="bottom", fontsize=7, zorder=4,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.4, "alpha": 0.8},
        )  # fmt: skip


def _draw_goals(axes: Axes, series: Series) -> None:
    for goal, sign in ((series.at_least, "at least"), (series.at_most, "at most")):
        if goal is not None:
            axes.axhline(goal, color=AGENTS[1], lw=1.1, ls="--")
            axes.annotate(
                f"goal: {sign} {goal:g}", xy=(1, goal), xycoords=("axes fraction", "data"), xytext=(0, -2),
                textcoords="offset points", ha="right", va="top", fontsize=7, color="#a23f00",
            )  # fmt: skip


def _draw_table(axes: Axes, columns: Mapping[int, Sequence[float]], norm: Normalize, form: str) -> None:
    table = np.array([columns[mission] for mission in sorted(columns)], dtype=np.float64).T
    axes.imshow(table, cmap=mpl.colormaps[VALUES].with_extremes(bad=NO_DATA), norm=norm, aspect="auto")
    missions = sorted(columns)
    every = -(-len(missions) // 12)
    axes.set_xticks(range(0, len(missions), every), [str(mission) for mission in missions[::every]])
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    if len(missions) > 12:
        return
    for row, column in np.argwhere(np.isfinite(table)).tolist():
        value = table[row, column]
        ink = "white" if norm(value) < 0.6 else INK
        axes.text(column, row, form.format(value), ha="center", va="center", fontsize=7, color=ink)


def _top(columns: Mapping[int, Sequence[float]]) -> float:
    values = np.array([value for column in columns.values() for value in column], dtype=np.float64)
    found = values[np.isfinite(values)]
    return float(found.max()) if found.size and found.max() > 0 else 1.0


def _png(figure: Figure) -> bytes:
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=_DPI, metadata={"Software": None})
    return data.getvalue()

"""What the pictures show: numbers, labels and the scales that make colours of them; nothing is drawn here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

VALUES, ERRORS, CLASSES = "viridis", "PuOr", "cividis"
"""Colour maps that people with colour-blindness can read."""


@dataclass(frozen=True)
class Scale:
    """How a map's numbers become colours.

    Args:
        label: What the numbers are, with their unit.
        low, high: Numbers at the ends of the colours; what lies outside has the colour of the end.
        colours: Name of a matplotlib colour map.
        steps: Whether the numbers are whole and each has a colour of its own.
    """

    label: str
    low: float
    high: float
    colours: str = VALUES
    steps: bool = False


@dataclass(frozen=True)
class Track:
    """The states that an agent visited, in order, in rows and columns of the context."""

    agent: str
    rows: Sequence[int]
    columns: Sequence[int]


@dataclass(frozen=True)
class Series:
    """One metric over missions, and the goals that speak of it."""

    label: str
    missions: Sequence[int]
    values: Sequence[float]
    at_least: float | None = None
    at_most: float | None = None


@dataclass(frozen=True, eq=False)
class Line:
    """Points in order; NaN is left out.

    Args:
        label: For the legend.
        x, y: Where the points are.
        dashed: Whether it is a bound, and not something that was measured.
    """

    label: str
    x: Sequence[float]
    y: Sequence[float]
    dashed: bool = False


@dataclass(frozen=True)
class Cloud:
    """Parameter sets of reward shaping as points.

    Args:
        x_label, y_label: What the axes are, with their units.
        x, y: Where each point is; NaN is left out.
        met: Whether a point met every goal.
        chosen: Index of the point that was chosen; None while there is none.
        at_least: Goal of y.
    """

    x_label: str
    y_label: str
    x: Sequence[float]
    y: Sequence[float]
    met: Sequence[bool]
    chosen: int | None = None
    at_least: float | None = None


def value_scale(label: str, grids: Sequence[NDArray[np.float64]]) -> Scale:
    """One scale for several maps, from the 1st to the 99th percentile so that a few outliers do not hide the rest."""
    low, high = spread(grids, 1, 99)
    return Scale(label, low, high)


def error_scale(label: str, errors: NDArray[np.float64]) -> Scale:
    """A scale with 0 in the middle."""
    low, high = spread([errors], 1, 99)
    reach = max(abs(low), abs(high)) or 1.0
    return Scale(label, -reach, reach, ERRORS)


def class_scale(label: str, grids: Sequence[NDArray[np.float64]]) -> Scale:
    """One colour a class, the same for several maps."""
    low, high = spread(grids, 0, 100)
    return Scale(label, np.floor(low), np.ceil(high), CLASSES, steps=True)


def spread(grids: Sequence[NDArray[np.float64]], lowest: float, highest: float) -> tuple[float, float]:
    """Two percentiles of all finite numbers of some grids; 0 and 1 when there is none."""
    values = np.concatenate([grid[np.isfinite(grid)] for grid in grids]) if grids else np.empty(0)
    if not values.size:
        return 0.0, 1.0
    low, high = np.percentile(values, [lowest, highest])
    return float(low), float(high)

"""How metrics are written for people: by their name's ending, in a unit that keeps numbers short.

`_j` is energy, `_s` is time; names that end in `accuracy`, `coverage` or `_share` are shares of 1.
"""

from __future__ import annotations

from collections.abc import Iterable

_SHARES = ("accuracy", "coverage", "_share")
_FIRST = ("accuracy", "coverage", "time_s", "uav_energy_j", "edge_energy_j", "energy_j")
_NAMES = {
    "time_s": "mission time",
    "uav_energy_j": "UAV energy",
    "edge_energy_j": "edge energy",
    "energy_j": "total energy",
    "mae": "mean absolute error",
}


def ordered(metrics: Iterable[str]) -> list[str]:
    """Metrics that every mission has first, then the others by name."""
    return sorted(set(metrics), key=lambda name: (_FIRST.index(name) if name in _FIRST else len(_FIRST), name))


def label(metric: str) -> str:
    """The metric in words: `uav_energy_j` is UAV energy, `distance_m` is distance m."""
    return _NAMES.get(metric, metric.removesuffix("_j").removesuffix("_s").replace("_", " "))


def scaled(metric: str) -> tuple[float, str]:
    """The factor that brings a metric to the unit in which it is drawn, and that unit."""
    if is_share(metric):
        return 100.0, "%"
    if metric.endswith("_j"):
        return 0.001, "kJ"
    return (1 / 60, "min") if metric.endswith("_s") else (1.0, "")


def text(metric: str, value: float | None) -> str:
    """A value with its unit: 71.3 %, 284.0 kJ, 12.5 J, 47 min 12 s; a dash when there is none."""
    if value is None:
        return "–"  # noqa: RUF001  # an en dash is the usual sign for an empty cell of a table
    if metric.endswith("_s") and not is_share(metric):
        return duration(value)
    factor, unit = scaled(metric)
    if unit == "kJ" and abs(value) < 1000:
        return f"{value:.1f} J"
    if unit:
        return f"{value * factor:,.1f} {unit}"
    return f"{value:,.0f}" if float(value).is_integer() or abs(value) >= 10_000 else f"{value:.4g}"


def duration(seconds: float) -> str:
    """A duration in the two greatest units that it has: 2 h 5 min, 47 min 12 s, 8.2 s, 20 ms."""
    if 0 < seconds < 1:
        return f"{1000 * seconds:.0f} ms"
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"


def is_share(metric: str) -> bool:
    """Whether a metric is a share of 1."""
    return metric.endswith(_SHARES)

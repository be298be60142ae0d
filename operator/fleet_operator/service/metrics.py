"""Numbers about the operator in the text format that Prometheus reads.

Source: Prometheus, "Exposition formats", text-based format 0.0.4.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass

Gauge = Callable[[], float]
Labels = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Metric:
    """One name: its type (counter or gauge) and what it means."""

    name: str
    kind: str
    meaning: str


API_CALLS = Metric("fleet_operator_api_calls_total", "counter", "Answers of the API server by verb and status code.")
PASSES = Metric("fleet_operator_passes_total", "counter", "Passes over a fleet by result.")
PASS_SECONDS = Metric("fleet_operator_pass_seconds_total", "counter", "Time that passes over fleets took.")
DUE = Metric("fleet_operator_fleets_due", "gauge", "Fleets that wait for a pass.")
RUNNING = Metric("fleet_operator_passes_running", "gauge", "Passes at work.")
FLEETS = Metric("fleet_operator_fleets", "gauge", "FleetSpecs.")
LEADING = Metric("fleet_operator_leading", "gauge", "1 for the replica that is at work.")


class Metrics:
    """Counters, and gauges that are read when they are asked for."""

    def __init__(self) -> None:
        self._counters: dict[Metric, dict[Labels, float]] = defaultdict(lambda: defaultdict(float))
        self._gauges: dict[Metric, Gauge] = {}

    def count(self, metric: Metric, amount: float = 1.0, **labels: str) -> None:
        """Add to a counter."""
        self._counters[metric][tuple(sorted(labels.items()))] += amount

    def watch(self, gauges: Mapping[Metric, Gauge]) -> None:
        """Read these whenever the numbers are asked for."""
        self._gauges.update(gauges)

    def text(self) -> str:
        """All numbers."""
        lines: list[str] = []
        for metric, values in self._counters.items():
            lines += [*_head(metric), *(_line(metric.name, labels, value) for labels, value in sorted(values.items()))]
        for metric, read in self._gauges.items():
            lines += [*_head(metric), _line(metric.name, (), read())]
        return "\n".join(lines) + "\n"


def _head(metric: Metric) -> list[str]:
    return [f"# HELP {metric.name} {metric.meaning}", f"# TYPE {metric.name} {metric.kind}"]


def _line(name: str, labels: Labels, value: float) -> str:
    shown = ",".join(f'{key}="{text}"' for key, text in labels)
    return f"{name}{{{shown}}} {value:g}" if shown else f"{name} {value:g}"

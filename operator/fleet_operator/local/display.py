"""Shows a run while it goes on: lines for logs and machines, bars on a terminal, nothing when told to be quiet."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from fleet.cli import console
from fleet_operator.local.events import ContainerDied, Event, JobFailed


@dataclass(frozen=True)
class Gauge:
    """How far one thing is.

    Args:
        total: None when nobody knows.
        text: What is shown in place of "done of total".
    """

    name: str
    done: int = 0
    total: int | None = None
    text: str = ""


class Display(Protocol):
    """Where a run says what it does."""

    draws: bool
    """Whether gauges are worth working out."""

    def phase(self, text: str) -> None:
        """Another phase begins."""

    def note(self, text: str) -> None:
        """A line that stays."""

    def event(self, event: Event) -> None:
        """Something happened on the machine."""

    def gauges(self, gauges: Sequence[Gauge]) -> None:
        """How far the phase is; called often."""

    def close(self) -> None:
        """Nothing more comes."""


class Quiet:
    """Says nothing but what went wrong for good."""

    draws = False

    def phase(self, text: str) -> None:
        """Nothing."""

    def note(self, text: str) -> None:
        """Nothing."""

    def event(self, event: Event) -> None:
        """A Job that failed for good."""
        if isinstance(event, JobFailed):
            console.note(event.reason)

    def gauges(self, gauges: Sequence[Gauge]) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""


class Lines:
    """A line on stderr for each phase and for what went wrong."""

    draws = False

    def phase(self, text: str) -> None:
        """The phase."""
        console.note(f"{text} ...")

    def note(self, text: str) -> None:
        """The line."""
        console.note(text)

    def event(self, event: Event) -> None:
        """What went wrong, and whether it is tried again."""
        match event:
            case ContainerDied(subject=subject, reason=reason, attempt=attempt):
                console.note(f"  {subject}, try {attempt}: {reason}\n  it is started again")
            case JobFailed(reason=reason):
                console.note(f"  {reason}")

    def gauges(self, gauges: Sequence[Gauge]) -> None:
        """Nothing: lines are for logs."""

    def close(self) -> None:
        """Nothing."""


class Bars(Lines):
    """The same lines, and below them bars that vanish with their phase."""

    draws = True

    def __init__(self) -> None:
        from rich.console import Console  # noqa: PLC0415 - rich is needed on a terminal only

        self._console = Console(stderr=True)
        self._progress: Any = None
        self._tasks: dict[str, Any] = {}

    def phase(self, text: str) -> None:
        """A new set of bars."""
        self._end_bars()
        super().phase(text)

    def note(self, text: str) -> None:
        """The line, above the bars."""
        self._end_bars()
        super().note(text)

    def event(self, event: Event) -> None:
        """The line, above the bars."""
        if isinstance(event, ContainerDied | JobFailed):
            self._end_bars()
        super().event(event)

    def gauges(self, gauges: Sequence[Gauge]) -> None:
        """Draw the bars; drawn here and not by a thread, as the runner starts processes."""
        if self._progress is None:
            self._begin_bars()
        for gauge in gauges:
            if gauge.name not in self._tasks:
                self._tasks[gauge.name] = self._progress.add_task(gauge.name, total=gauge.total, text="")
            text = gauge.text or (f"{gauge.done} of {gauge.total}" if gauge.total else "")
            self._progress.update(self._tasks[gauge.name], completed=gauge.done, total=gauge.total, text=text)
        self._progress.refresh()

    def close(self) -> None:
        """Leave the terminal as it was."""
        self._end_bars()

    def _begin_bars(self) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn  # noqa: PLC0415 - as above

        columns = (
            TextColumn("  {task.description}"),
            BarColumn(),
            TextColumn("{task.fields[text]}"),
            TimeElapsedColumn(),
        )
        self._progress = Progress(*columns, console=self._console, transient=True, auto_refresh=False)
        self._progress.start()

    def _end_bars(self) -> None:
        if self._progress is not None:
            self._progress.stop()
        self._progress, self._tasks = None, {}


def open_display(quiet: bool) -> Display:
    """The display that fits: bars on a terminal, else lines."""
    if quiet:
        return Quiet()
    return Bars() if sys.stderr.isatty() else Lines()

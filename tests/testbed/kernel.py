"""Settings of this computer's kernel that beds need otherwise: saved by the first bed, put back by the last."""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path("/run/fleet-testbed")
SETTINGS = Path("/proc/sys")
# Kubelets, containerds and pods of all machines count as one user.
LOWEST = {"fs/inotify/max_user_instances": 8192, "fs/inotify/max_user_watches": 262144}


def enter(bed: str) -> None:
    """Raise the settings for a bed."""
    with _state() as state:
        beds, before = state["beds"], state["before"]
        beds[bed] = 1
        for name, lowest in LOWEST.items():
            value = int((SETTINGS / name).read_text())
            if value < lowest:
                before.setdefault(name, value)
                (SETTINGS / name).write_text(str(lowest))


def leave(bed: str) -> None:
    """Put the settings back when no other bed is there."""
    with _state() as state:
        state["beds"].pop(bed, None)
        if not state["beds"]:
            for name, value in state["before"].items():
                (SETTINGS / name).write_text(str(value))
            state["before"].clear()


@contextmanager
def _state() -> Iterator[dict[str, dict[str, int]]]:
    """The beds that are there, and the settings as they were before."""
    ROOT.mkdir(parents=True, exist_ok=True)
    with (ROOT / "kernel.json").open("a+") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        state = json.loads(file.read() or '{"beds": {}, "before": {}}')
        yield state
        file.seek(0)
        file.truncate()
        file.write(json.dumps(state))

"""Finished runs of small, real swarms, for all tests that only look at one or copy it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.scouting import finish, running, words, write_swarm


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a swarm (`swarm/`) and its finished run (`out/`)."""
    return _flown(tmp_path_factory.mktemp("undisturbed"))


@pytest.fixture(scope="session")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same of a swarm whose agents plan together, over nearly all of the field."""
    return _flown(
        tmp_path_factory.mktemp("planned"),
        sa={"kind": "Planner"},
        ha={"caution": 1.5},
        goals=[{"metric": "accuracy", "atLeast": 0.7}],
    )


def _flown(folder: Path, **changes: Any) -> Path:
    file = write_swarm(folder / "swarm", **changes)
    with running(file, folder / "out") as run:
        assert finish(run, folder / "out") in {0, 1}, words(folder / "out")
    return folder

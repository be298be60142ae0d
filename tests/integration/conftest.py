"""One finished run of a small, real swarm, for all tests that only look at it or copy it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.scouting import finish, running, words, write_swarm


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a swarm (`swarm/`) and its finished run (`out/`)."""
    folder = tmp_path_factory.mktemp("undisturbed")
    file = write_swarm(folder / "swarm")
    with running(file, folder / "out") as run:
        assert finish(run, folder / "out") in {0, 1}, words(folder / "out")
    return folder

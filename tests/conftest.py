"""Fixtures that every kind of test may use."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

pytest_plugins = ["tests.testbed.fixtures", "tests.testbed.hdfs_fixtures", "tests.crash.fixtures"]

ROOT = Path(__file__).resolve().parent.parent

# A shell that starts the tests in the background has them ignore Ctrl-C, and so would the programs that they interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# How fast a machine is says nothing about the code: examples have no deadline, and making them may take long.
settings.register_profile("fleet", deadline=None, suppress_health_check=[HealthCheck.too_slow])
# The same examples in each run of CI, and a failing one printed so that it can be run again elsewhere.
settings.register_profile("fleet-ci", settings.get_profile("fleet"), derandomize=True, database=None, print_blob=True)
settings.load_profile("fleet-ci" if os.environ.get("CI") else "fleet")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-golden", action="store_true", help="write golden files anew instead of comparing")


@pytest.fixture
def update_golden(request: pytest.FixtureRequest) -> bool:
    """Whether golden files are to be written anew."""
    return bool(request.config.getoption("--update-golden"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real data that is not part of the project."""
    folder = Path(os.environ.get("FLEET_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"the real data is not at {folder}; set FLEET_DATA to its folder")
    return folder

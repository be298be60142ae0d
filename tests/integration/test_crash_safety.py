"""The operator may be killed before or after any of its writes: the fleet comes to the same end.

A seeded sample; `make crash-test` does it for every write, and for a run of two missions.
"""

from __future__ import annotations

import pytest

from tests.crash.runs import KILLS, Runs

pytest_plugins = ["tests.crash.fixtures"]
pytestmark = pytest.mark.xdist_group("crash")


@pytest.mark.parametrize("crash_kill", range(KILLS))
def test_a_fleet_whose_operator_was_killed_comes_to_the_same_end(crash_runs: Runs, crash_kill: int) -> None:
    assert crash_runs.kill(crash_kill) == [], str(crash_runs.kills[crash_kill])

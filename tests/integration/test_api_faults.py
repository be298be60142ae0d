"""Whatever fails around the operator, the fleet comes to the end that it comes to when nothing fails.

Scenarios that take long are left to `make crash-test`.
"""

from __future__ import annotations

import pytest

from tests.crash.runs import Runs
from tests.crash.scenarios import SCENARIOS, Scenario

pytest_plugins = ["tests.crash.fixtures"]
pytestmark = pytest.mark.xdist_group("crash")
QUICK = [pytest.param(each, id=each.name) for each in SCENARIOS if each.quick]


@pytest.mark.parametrize("scenario", QUICK)
def test_a_fleet_comes_to_the_same_end(crash_runs: Runs, scenario: Scenario) -> None:
    assert crash_runs.scenario(scenario) == []

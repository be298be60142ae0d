"""Fixtures of the crash tests; test modules plug this in by `pytest_plugins`, and share one world."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.crash.runs import Runs
from tests.crash.scenarios import Scenario
from tests.crash.world import side_by_side, world
from tests.testbed.requirements import need


@pytest.fixture(scope="session")
def crash_runs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Runs]:
    """Control plane, HDFS and stand-in kubelets with all runs; shared by all tests of the group `crash`."""
    need("openssl", "setpriv", "java", "etcd", "kube-apiserver", "kube-controller-manager", "kubectl")
    chosen = [getattr(item, "callspec").params for item in request.session.items if hasattr(item, "callspec")]  # noqa: B009 - pytest's items have no public type with it
    scenarios = [each["scenario"] for each in chosen if isinstance(each.get("scenario"), Scenario)]
    kills = [each["crash_kill"] for each in chosen if "crash_kill" in each]
    with world(tmp_path_factory.mktemp("crash"), slots=side_by_side()) as place:
        runs = Runs(place, scenarios, kills)
        try:
            yield runs
        finally:
            runs.close()

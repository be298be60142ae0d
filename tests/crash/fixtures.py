"""The world of crash tests for pytest."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.crash.trial import Plan, Result, run_trial
from tests.crash.world import World, cores, world
from tests.testbed.requirements import need


@pytest.fixture(scope="session")
def crash_world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    """Control plane, HDFS of three DataNodes and stand-in kubelets; shared by all tests of the group `crash`."""
    need("openssl", "setpriv", "java", "etcd", "kube-apiserver", "kube-controller-manager", "kubectl")
    with world(tmp_path_factory.mktemp("crash"), slots=cores()) as place:
        yield place


@pytest.fixture(scope="session")
def undisturbed(crash_world: World) -> Result:
    """What a run comes to when nothing goes wrong."""
    return run_trial(crash_world, Plan("undisturbed"))

"""Fixtures of the test bed; `tests/conftest.py` plugs them in.

`control_plane`: an API server with controllers, without machines. `bed`: four machines. `cluster`: those, or the
cluster that KUBECONFIG names when FLEET_TEST_CLUSTER=kubeconfig is set; tests of `bed` are then left out.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.testbed.access import Access
from tests.testbed.bed import PROGRAMS, Bed
from tests.testbed.bed import bed as run_bed
from tests.testbed.control_plane import ControlPlane
from tests.testbed.control_plane import control_plane as run_control_plane
from tests.testbed.errors import BedError
from tests.testbed.requirements import need, refuse

GROUP = "bed"


def pytest_configure(config: pytest.Config) -> None:
    """Declare the marker of tests that need machines of our own."""
    config.addinivalue_line("markers", "machines: needs machines of our own, which it may switch off")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of machines, and have one worker run them all: each worker would make machines of its own."""
    for item in items:
        names = getattr(item, "fixturenames", ())
        if "bed" in names:
            item.add_marker("machines")
        if {"bed", "cluster"} & set(names) and item.get_closest_marker("xdist_group") is None:
            item.add_marker(pytest.mark.xdist_group(GROUP))


def elsewhere() -> Path | None:
    """The kubeconfig of a cluster that is not ours, when tests are to run there."""
    if os.environ.get("FLEET_TEST_CLUSTER") != "kubeconfig":
        return None
    path = Path(os.environ.get("KUBECONFIG", Path.home() / ".kube/config"))
    if not path.is_file():
        pytest.fail(f"FLEET_TEST_CLUSTER=kubeconfig is set, but {path} is no file: set KUBECONFIG")
    return path


@pytest.fixture(scope="session")
def control_plane(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ControlPlane]:
    """A control plane with controllers and without machines; one per pytest worker: use a namespace of your own."""
    need("openssl", "setpriv", "etcd", "kube-apiserver", "kube-controller-manager", "kubectl")
    with run_control_plane(tmp_path_factory.mktemp("control-plane")) as plane:
        yield plane


@pytest.fixture(scope="session")
def bed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bed]:
    """Four machines with the images of the Fleet Computer; a test that switches one off switches it on again."""
    if elsewhere() is not None:
        pytest.skip("this test needs machines of our own: unset FLEET_TEST_CLUSTER to run it")
    from tests.testbed.images import PODS, ensure_images  # noqa: PLC0415 - most tests need no image builder

    need("machines", *PROGRAMS, "kubectl")
    try:
        images = list(ensure_images(*PODS).values())
    except BedError as error:
        refuse(str(error))
    with run_bed(tmp_path_factory.mktemp("bed"), images) as machines:
        yield machines


@pytest.fixture(scope="session")
def cluster(request: pytest.FixtureRequest) -> Access:
    """A cluster with nodes: the one that KUBECONFIG names if FLEET_TEST_CLUSTER=kubeconfig is set, else `bed`."""
    path = elsewhere()
    if path is not None:
        return Access(path)
    machines: Bed = request.getfixturevalue("bed")
    return machines

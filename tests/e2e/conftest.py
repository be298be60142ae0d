"""The Fleet Computer on the test bed's machines, installed once for all tests."""

from __future__ import annotations

import pytest

from fleet.storage.hdfs import HdfsStorage
from tests.chart import PREVIOUS_CHART, Helm
from tests.testbed.bed import Bed
from tests.testbed.installation import RELEASE, SYSTEM, install, reach_storage
from tests.testbed.requirements import need


@pytest.fixture(scope="session")
def installed(bed: Bed, tmp_path_factory: pytest.TempPathFactory) -> HdfsStorage:
    """The chart on the bed, upgraded from the one before; its HDFS as this computer reaches it."""
    need("helm")
    helm = Helm(tmp_path_factory.mktemp("helm"), bed.kubeconfig)
    if not bed.kubectl("get", "namespace", SYSTEM, "--ignore-not-found", "--output=name"):
        helm("install", RELEASE, PREVIOUS_CHART, "--namespace", SYSTEM, "--create-namespace")
    install(bed, "10m")
    return reach_storage(bed)

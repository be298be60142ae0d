"""The Fleet Computer on the test bed's machines, installed once for all tests."""

from __future__ import annotations

import pytest

from fleet.storage.hdfs import HdfsStorage
from tests.testbed.bed import Bed
from tests.testbed.installation import install, reach_storage
from tests.testbed.requirements import need


@pytest.fixture(scope="session")
def installed(bed: Bed) -> HdfsStorage:
    """The chart on the bed; its HDFS as this computer reaches it."""
    need("helm")
    install(bed, "10m")
    return reach_storage(bed)

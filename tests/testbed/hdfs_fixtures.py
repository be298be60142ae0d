"""The fixture of HDFS; `tests/conftest.py` plugs it in."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.testbed.hdfs import HdfsCluster
from tests.testbed.hdfs import hdfs_cluster as run_hdfs_cluster
from tests.testbed.requirements import need


@pytest.fixture(scope="session")
def hdfs_cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[HdfsCluster]:
    """HDFS with three DataNodes; one per pytest worker: use a folder of your own, and leave everything running."""
    need("setpriv", "hadoop")
    with run_hdfs_cluster(tmp_path_factory.mktemp("hdfs")) as cluster:
        yield cluster

"""The same mission over HDFS as over a local directory, while a DataNode goes."""

from __future__ import annotations

from pathlib import Path
from uuid import uuid4

import pytest

from fleet.storage.local import LocalStorage
from fleet.storage.open import open_storage
from fleet.storage.port import Storage
from tests.scouting import PATHS, finish, running, words
from tests.testbed.hdfs import HdfsCluster
from tests.testbed.waiting import wait_for

pytestmark = pytest.mark.xdist_group("hdfs")


def test_a_mission_over_hdfs_gives_the_same_bytes(undisturbed: Path, hdfs_cluster: HdfsCluster, tmp_path: Path) -> None:
    uri = f"{hdfs_cluster.uri}/{uuid4().hex}"
    place, local = open_storage(uri), LocalStorage(undisturbed / "out/storage")
    with running(undisturbed / "swarm/fleetspec.yaml", tmp_path, "--storage", uri) as run:
        assert finish(run, tmp_path) in {0, 1}, words(tmp_path)
    print([e.path for e in local.list("") if not place.exists(e.path) or place.read(e.path)!=local.read(e.path)], len(local.list("")), len(place.list("")))
    assert 0

"""A mission over HDFS is the mission over a local directory, even when a DataNode goes in the middle."""

from __future__ import annotations

from pathlib import Path
from uuid import uuid4

import pytest

from fleet.storage.local import LocalStorage
from fleet.storage.open import open_storage
from tests.scouting import PATHS, finish, running, words
from tests.testbed.hdfs import HdfsCluster
from tests.testbed.waiting import wait_for

pytestmark = pytest.mark.xdist_group("hdfs")
TIMES_TAKEN = ("/retraining/", "/weighing.json", "/training/report.json")
"""Objects that say how long something took."""


def test_a_mission_over_hdfs_gives_the_same_bytes(undisturbed: Path, hdfs_cluster: HdfsCluster, tmp_path: Path) -> None:
    uri = f"{hdfs_cluster.uri}/{uuid4().hex}"
    storage, local = open_storage(uri), LocalStorage(undisturbed / "out/storage")
    with running(undisturbed / "swarm/fleetspec.yaml", tmp_path, "--storage", uri) as run:
        log = PATHS.log(1, "agent-1")
        wait_for("the first record", lambda: storage.exists(log) or run.poll() is not None, 240)
        hdfs_cluster.stop_datanode(1)
        try:
            assert finish(run, tmp_path) in {0, 1}, words(tmp_path)
            found = [entry.path for entry in storage.list("")]
            assert found == [entry.path for entry in local.list("")]
            same = [path for path in found if not any(part in path for part in TIMES_TAKEN)]
            assert [path for path in same if storage.read(path) != local.read(path)] == []
        finally:
            hdfs_cluster.start_all()
    assert log in same
    assert PATHS.evaluation(1) in same
    assert PATHS.model(1, "1-2") in same

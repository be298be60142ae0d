"""DataNodes and NameNodes go while many write: nothing that was acknowledged is lost, doubled, or there once only."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterator
from uuid import uuid4

import pytest

from fleet.errors import FleetError, StorageUnavailable
from fleet.storage import webhdfs_transport
from fleet.storage.hdfs import HdfsStorage
from fleet.storage.webhdfs_address import WebHdfsAddress
from tests.contract.storage_writer import line, number_of, whole
from tests.testbed.hdfs import HdfsCluster
from tests.testbed.waiting import wait_for

pytestmark = pytest.mark.xdist_group("hdfs")
WORKERS = 3
ROUNDS = 24
DEAD = 0


@pytest.fixture
def storage(hdfs_cluster: HdfsCluster) -> Iterator[HdfsStorage]:
    storage = HdfsStorage(WebHdfsAddress.parse(f"{hdfs_cluster.uri}/{uuid4().hex}"))
    yield storage
    hdfs_cluster.start_all()
    hdfs_cluster.delete(storage.address.root)


class Load:
    """Workers that append lines and replace objects; one round after the other, each acknowledged."""

    def __init__(self, storage: HdfsStorage) -> None:
        self._storage = storage
        self._problems: list[FleetError] = []
        self._done = [0] * WORKERS
        self._threads = [threading.Thread(target=self._work, args=(worker,)) for worker in range(WORKERS)]

    def start(self) -> None:
        for thread in self._threads:
            thread.start()

    def reached(self, rounds: int) -> bool:
        return min(self._done) >= rounds or bool(self._problems)

    def finish(self) -> None:
        for thread in self._threads:
            thread.join()
        assert self._problems == []

    def _work(self, worker: int) -> None:
        try:
            for number in range(ROUNDS):
                self._storage.append(f"{worker}/log", line(number))
                self._storage.write(f"{worker}/whole/{number % 4}", whole(number, 5_000))
                self._done[worker] += 1
        except FleetError as error:
            self._problems.append(error)


def kill_datanode(cluster: HdfsCluster) -> None:
    cluster.stop_datanode(DEAD)


def stop_datanode(cluster: HdfsCluster) -> None:
    cluster.stop_datanode(DEAD, kill=False)


def restart_namenode(cluster: HdfsCluster) -> None:
    cluster.stop_namenode()
    cluster.start_namenode(wait=False)


@pytest.mark.parametrize("fault", [kill_datanode, stop_datanode, restart_namenode])
def test_nothing_acknowledged_is_lost_or_doubled(
    storage: HdfsStorage, hdfs_cluster: HdfsCluster, fault: Callable[[HdfsCluster], None]
) -> None:
    load = Load(storage)
    load.start()
    wait_for("some rounds", lambda: load.reached(ROUNDS // 3))
    fault(hdfs_cluster)
    load.finish()

    expected = b"".join(line(number) for number in range(ROUNDS))
    for worker in range(WORKERS):
        assert storage.read(f"{worker}/log") == expected
        objects = [number_of(storage.read(f"{worker}/whole/{number}")) for number in range(4)]
        assert objects == [ROUNDS - 4, ROUNDS - 3, ROUNDS - 2, ROUNDS - 1]
        if fault is not restart_namenode:
            living = set(storage.locations(f"{worker}/whole")) - {hdfs_cluster.hosts[DEAD]}
            assert living == set(hdfs_cluster.hosts[1:])
    assert {entry.path.partition("/")[2] for entry in storage.list("")} == {"log", *(f"whole/{n}" for n in range(4))}

    hdfs_cluster.start_all()
    wait_for("two live copies of every block", lambda: copies(hdfs_cluster, storage) >= 2)


def copies(cluster: HdfsCluster, storage: HdfsStorage) -> int:
    """Fewest live copies of a block, as the NameNode counts them."""
    return min(int(found) for found in re.findall(r"Live_repl=(\d+)", cluster.fsck(storage.address.root)))


def test_a_hung_datanode_that_wakes_adds_nothing(
    storage: HdfsStorage, hdfs_cluster: HdfsCluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(webhdfs_transport, "ASKED_S", 0.5)
    for text in (b"one\n", b"two\n"):
        storage.append("log", text)
    known = storage._appends._known[f"{storage.address.root}/log"]  # no public name: only this test needs it
    taker = next(index for index, host in enumerate(hdfs_cluster.hosts) if known and f"//{host}:" in known.node)
    hdfs_cluster.freeze_datanode(taker)
    try:
        storage.append("log", b"three\n")
        assert storage.read("log") == b"one\ntwo\nthree\n"
    finally:
        hdfs_cluster.thaw_datanode(taker)
    wait_for("the DataNode's answer", lambda: hdfs_cluster.answers(taker))
    storage.append("log", b"four\n")
    assert storage.read("log") == b"one\ntwo\nthree\nfour\n"


def test_one_living_datanode_takes_nothing_as_it_could_keep_one_copy_only(
    storage: HdfsStorage, hdfs_cluster: HdfsCluster
) -> None:
    storage.write("kept/a", b"1")
    keeper = next(iter(storage.locations("kept")))
    for index, host in enumerate(hdfs_cluster.hosts):
        if host != keeper:
            hdfs_cluster.stop_datanode(index)
    impatient = HdfsStorage(storage.address, patience_s=1.0)
    with pytest.raises(StorageUnavailable, match=r"is gone or cannot be reached|check the DataNode"):
        impatient.write("kept/a", b"2")
    assert storage.read("kept/a") == b"1"

"""HDFS over WebHDFS keeps the storage contract; and what only HDFS has."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar
from uuid import uuid4

import pytest
import requests

from fleet.errors import StorageError, StorageReadOnly, StorageUnavailable
from fleet.storage import hdfs
from fleet.storage.hdfs import HdfsStorage
from fleet.storage.hdfs_files import HdfsFiles
from fleet.storage.port import Entry, Located
from fleet.storage.webhdfs import WebHdfs, _Client
from fleet.storage.webhdfs_address import WebHdfsAddress
from fleet.storage.webhdfs_answers import Fate, Refused
from tests.contract.storage_contract import StorageContract
from tests.testbed.hdfs import HdfsCluster

pytestmark = pytest.mark.xdist_group("hdfs")
T = TypeVar("T")


@contextmanager
def folder_of(cluster: HdfsCluster) -> Iterator[HdfsStorage]:
    storage = HdfsStorage(WebHdfsAddress.parse(f"{cluster.uri}/{uuid4().hex}"))
    yield storage
    cluster.delete(storage.address.root)


@pytest.fixture
def storage(hdfs_cluster: HdfsCluster) -> Iterator[HdfsStorage]:
    with folder_of(hdfs_cluster) as storage:
        yield storage


class TestHdfsStorage(StorageContract):
    kills = 3
    replacements = 20

    @pytest.fixture
    def storage(self, hdfs_cluster: HdfsCluster) -> Iterator[HdfsStorage]:
        with folder_of(hdfs_cluster) as storage:
            yield storage

    @pytest.fixture
    def full_storage(self, storage: HdfsStorage, hdfs_cluster: HdfsCluster) -> HdfsStorage:
        storage.write("kept", b"kept")
        hdfs_cluster.set_space_quota(storage.address.root, 5 << 20)  # room for two blocks of two copies
        return storage

    @pytest.fixture
    def read_only_storage(self, storage: HdfsStorage, hdfs_cluster: HdfsCluster) -> HdfsStorage:
        storage.write("kept", b"kept")
        for path in ("", "/kept"):
            hdfs_cluster.set_owner(f"{storage.address.root}{path}", "somebody")
        return storage


# copies and places


def test_what_is_acknowledged_has_as_many_copies_as_the_address_asks_for(storage: HdfsStorage) -> None:
    storage.write("whole", b"1" * 1000)
    storage.append("log", b"2")
    storage.append("log", b"3")
    assert [storage.copies(path) for path in ("whole", "log")] == [2, 2]
    three = HdfsStorage(replace(storage.address, replication=3))
    three.write("whole", b"1" * 1000)
    assert (three.copies("whole"), three.uri) == (3, f"{storage.uri}?replication=3")
    three.check_copies()
    assert three.list("") == [Entry("log", 2), Entry("whole", 1000)]


def test_fewer_copies_than_asked_for_are_said(storage: HdfsStorage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hdfs, "COPIES_S", 0.3)
    with pytest.raises(StorageError, match=r"keeps 3 of 4 copies .* start 4 DataNodes"):
        HdfsStorage(replace(storage.address, replication=4)).check_copies()
    with pytest.raises(StorageError, match=r"required minimum of 2.*dfs.namenode.replication.min"):
        HdfsStorage(replace(storage.address, replication=1)).write("a", b"1")
    assert storage.list("") == []


def test_locations_are_the_bytes_that_each_datanode_holds(storage: HdfsStorage, hdfs_cluster: HdfsCluster) -> None:
    assert isinstance(storage, Located)
    sizes = {"a": 3 << 20, "deep/b": 1000, "deep/er/c": 0}  # three blocks, one, none
    for path, size in sizes.items():
        storage.write(f"here/{path}", bytes(size))
    storage.write("there/d", b"1")
    held = storage.locations("here")
    assert sum(held.values()) == 2 * sum(sizes.values())
    assert set(held) <= set(hdfs_cluster.hosts)
    assert storage.locations("nowhere") == {}


# identity


def test_objects_belong_to_the_user_of_the_address_or_to_whom_he_acts_for(hdfs_cluster: HdfsCluster) -> None:
    with folder_of(hdfs_cluster) as storage:
        storage.write("a", b"1")
        alice = HdfsStorage(replace(storage.address, on_behalf_of="alice"))
        assert alice.read("a") == b"1"
        with pytest.raises(StorageReadOnly, match="make the directory writable for user alice"):
            alice.write("b", b"1")
        hdfs_cluster.set_owner(storage.address.root, "alice")
        alice.write("b", b"1")
        alice.append("b", b"2")
        assert (alice.read("b"), storage.exists("b")) == (b"12", True)
        impostor = HdfsStorage(replace(storage.address, user="alice", on_behalf_of="fleet"))
        with pytest.raises(StorageUnavailable, match=r"hadoop.proxyuser.alice.hosts"):
            impostor.read("a")


# what writers leave


def test_what_a_killed_writer_left_is_not_listed_and_goes_in_time(
    storage: HdfsStorage, hdfs_cluster: HdfsCluster
) -> None:
    files = HdfsFiles(WebHdfs(storage.address), 5.0)
    names = ["~old~1", "~young~1"]
    for name in names:
        files.door.create(f"{storage.address.root}/folder/{name}", b"half of an obj")
    hdfs_cluster.set_modified(f"{storage.address.root}/folder/~old~1", time.time() - 2 * 3600)
    assert storage.list("") == []
    assert [item.name for item in files.contents(f"{storage.address.root}/folder")] == ["~young~1"]


# answers that get lost


@pytest.mark.parametrize("patience_s", [0.0, 30.0])
@pytest.mark.parametrize("arrives", [False, True])
def test_any_lost_request_or_answer_changes_nothing(
    storage: HdfsStorage, monkeypatch: pytest.MonkeyPatch, arrives: bool, patience_s: float
) -> None:
    calls = Calls(WebHdfs._call)
    monkeypatch.setattr(WebHdfs, "_call", lambda door, ask: calls(door, ask, arrives=arrives))
    rounds = 0
    while calls.lost or rounds == 0:
        calls.lose(rounds)
        work = HdfsStorage(replace(storage.address, root=f"{storage.address.root}/{rounds}"), patience_s)
        insist(partial(work.write, "a", b"1"))
        for line in (b"one\n", b"two\n", b"three\n"):
            insist(partial(work.append, "log", line))
        insist(partial(work.delete, "a"))
        assert insist(partial(work.read, "log")) == b"one\ntwo\nthree\n"
        assert insist(partial(work.list, "")) == [Entry("log", 14)]
        rounds += 1
    assert rounds > 10


def insist(act: Callable[[], T]) -> T:
    """Trying again is safe, the port says."""
    while True:
        with suppress(StorageUnavailable):
            return act()


class Calls:
    """Calls of WebHDFS, one of which gets lost: on its way to the server, or the answer on its way back."""

    def __init__(self, call: Callable[[WebHdfs, Any], Any]) -> None:
        self._call = call
        self._left = 0
        self.lost = False

    def lose(self, number: int) -> None:
        self._left, self.lost = number, False

    def __call__(self, door: WebHdfs, ask: Any, *, arrives: bool) -> Any:
        self._left -= 1
        if self._left != -1:
            return self._call(door, ask)
        self.lost = True
        if arrives:
            self._call(door, ask)
        raise Refused(Fate.PASSING, "the cable was cut")


@pytest.mark.parametrize("arrived", [1, 3, 6])
def test_an_append_of_which_a_part_arrived_is_completed(
    storage: HdfsStorage, monkeypatch: pytest.MonkeyPatch, arrived: int
) -> None:
    whole_send, cut = _Client.send, [arrived]

    def send(client: _Client, method: str, url: str, data: bytes) -> requests.Response:
        if method == "POST" and cut:
            whole_send(client, method, url, data[: cut.pop()])
            raise requests.ConnectionError("the cable was cut")
        return whole_send(client, method, url, data)

    monkeypatch.setattr(_Client, "send", send)
    storage.append("log", b"one\n")
    storage.append("log", b"three\n")
    assert (cut, storage.read("log")) == ([], b"one\nthree\n")
    storage.append("log", b"four\n")
    assert storage.read("log") == b"one\nthree\nfour\n"


def test_an_object_that_another_process_changed_is_not_appended_to_before_it_is_read(storage: HdfsStorage) -> None:
    other = HdfsStorage(storage.address)
    assert storage.list("") == []
    storage.append("log", b"one\n")
    assert other.read("log") == b"one\n"
    storage.append("log", b"two\n")
    for _ in range(2):
        with pytest.raises(StorageError, match="another process has written to it"):
            other.append("log", b"three\n")
    assert other.read("log") == b"one\ntwo\n"
    other.append("log", b"three\n")
    assert storage.read("log") == b"one\ntwo\nthree\n"


def test_a_process_whose_object_another_one_took_over_appends_no_more(storage: HdfsStorage) -> None:
    other = HdfsStorage(storage.address)
    storage.append("log", b"one\n")
    storage.append("log", b"two\n")
    other.append("log", b"three\n")
    for _ in range(2):
        with pytest.raises(StorageError, match="another process has written to it"):
            storage.append("log", b"late\n")
    other.append("log", b"four\n")
    assert other.read("log") == b"one\ntwo\nthree\nfour\n"

"""An operator that may have lost its lease changes nothing in storage, and storages that nobody uses are forgotten."""

from __future__ import annotations

import asyncio
import json
import math
from pathlib import Path

import pytest

from fleet.storage import limits
from fleet.storage.layout import CLAIMS
from fleet.storage.local import LocalStorage
from fleet.storage.port import Located, Storage
from fleet_operator.__main__ import fleet_reconciler
from fleet_operator.cluster.connection import connect
from fleet_operator.cluster.credentials import Credentials
from fleet_operator.cluster.errors import NotLeading
from fleet_operator.compiler.settings import Settings
from fleet_operator.config import Config
from fleet_operator.reconcile.fence import SMALL_BYTES, fenced
from fleet_operator.reconcile.storages import Storages
from fleet_operator.resources.refs import ObjectRef
from tests.reconciled import PATHS, REF, Reconciled, WatchedStorage


@pytest.fixture
def run(tmp_path: Path, quick_disk: None) -> Reconciled:
    return Reconciled(tmp_path)


def content(storage: Storage) -> dict[str, bytes]:
    return {entry.path: storage.read(entry.path) for entry in storage.list("")}


def test_behind_the_fence_everything_is_read_and_nothing_changed_without_the_lease(tmp_path: Path) -> None:
    left_s = math.inf
    plain = LocalStorage(tmp_path)
    storage = fenced(lambda uri: plain, lambda: left_s)("any")
    storage.write("a/b", b"1")
    storage.append("a/b", b"2")
    storage.write("c", b"3")
    storage.delete("c")
    left_s = 0.0
    for change in (
        lambda: storage.write("a/b", b""),
        lambda: storage.append("a/b", b"3"),
        lambda: storage.delete("a"),
    ):
        with pytest.raises(NotLeading, match="another process may hold the lease"):
            change()
    assert (storage.uri, storage.read("a/b"), storage.exists("a/b")) == (plain.uri, b"12", True)
    assert storage.list("") == plain.list("")
    assert content(plain) == {"a/b": b"12"}


def test_a_change_is_tried_only_as_long_as_the_lease_lasts_but_a_large_object_takes_its_time(tmp_path: Path) -> None:
    left: list[float] = []
    watched = WatchedStorage(LocalStorage(tmp_path), lambda name: left.append(limits.left_s()))
    storage = fenced(lambda uri: watched, lambda: 7.0)("any")
    storage.delete("a")
    storage.write("a", b"1")
    storage.write("b", bytes(SMALL_BYTES + 1))
    assert [each <= 7.0 for each in left] == [True, True, False]


@pytest.mark.parametrize("located", [True, False])
def test_a_fence_knows_where_objects_are_when_the_storage_does(tmp_path: Path, located: bool) -> None:
    plain = LocalStorage(tmp_path)
    inner: Storage = WatchedStorage(plain, lambda name: None, {"a": {"hub": 3}}) if located else plain
    storage = fenced(lambda uri: inner, lambda: 1.0)("any")
    assert isinstance(storage, Located) == located
    if isinstance(storage, Located):
        assert storage.locations("a") == {"hub": 3}


def test_a_pass_whose_lease_is_lost_leaves_storage_as_it_is(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Flying")
    run.cluster.end_job("plots-m0001-workflow-agent-2", "it fell")
    left_s = 10.0

    def lose(name: str) -> None:
        nonlocal left_s
        left_s = 0.0  # while the pass looks at storage

    run.opened = fenced(run.opened, lambda: left_s)
    run.restart()
    run.before_storage = lose
    before = content(run.storage)
    with pytest.raises(NotLeading):
        run.look()
    assert content(run.storage) == before
    run.before_storage, left_s = lambda name: None, 10.0
    run.look()
    assert run.storage.exists(PATHS.landing(1, "agent-2"))


def test_the_operator_as_it_runs_has_its_storage_behind_the_lease_of_its_transport(run: Reconciled) -> None:
    run.ask()
    run.settle(until="Flying")
    last = run.delete()
    kubeconfig = run.folder / "kubeconfig"
    cluster = {"name": "c", "cluster": {"server": "http://127.0.0.1:1"}}
    context = {"name": "x", "context": {"cluster": "c", "user": ""}}
    kubeconfig.write_text(json.dumps({"clusters": [cluster], "contexts": [context], "current-context": "x"}))
    connection = connect(Credentials({"KUBECONFIG": str(kubeconfig)}), ObjectRef("fleet-system", "lease"))
    connection.transport.left_s = lambda: 0.0
    reconciler = fleet_reconciler(Config(settings=Settings(storage_uri=run.storage.uri)), connection)
    with pytest.raises(NotLeading):
        asyncio.run(reconciler.forget(REF, last))
    assert run.storage.list(CLAIMS)
    connection.transport.left_s = lambda: 10.0
    asyncio.run(reconciler.forget(REF, last))
    assert run.storage.list(CLAIMS) == []


def test_only_the_storages_that_were_used_last_are_kept_open(tmp_path: Path) -> None:
    opened: list[str] = []

    def open_one(uri: str) -> Storage:
        opened.append(uri)
        return LocalStorage(tmp_path / uri)

    storages = Storages(open_one, most=2)
    first = storages.at("a")
    assert [storages.at(uri) is first for uri in ("b", "a", "c", "a")] == [False, True, False, True]
    storages.at("b")
    assert opened == ["a", "b", "c", "b"]

"""What the operator's process does with a reconciler that fails: nobody waits for what is not his."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from fleet.errors import SpecError, StorageUnavailable
from fleet.storage.limits import left_s
from fleet_operator.cluster.connection import Connection, connect
from fleet_operator.cluster.credentials import Credentials
from fleet_operator.cluster.errors import Unavailable
from fleet_operator.cluster.memory import Listeners
from fleet_operator.cluster.shelves import FLEETS
from fleet_operator.config import Config
from fleet_operator.resources.refs import Manifest, ObjectRef
from fleet_operator.service import service as module
from fleet_operator.service.metrics import Metrics
from fleet_operator.service.service import LONGEST_PASS_S, PASS_STORAGE_S, Service

CROP, OTHER = ObjectRef("farm", "crop"), ObjectRef("farm", "other")
KUBECONFIG = """
apiVersion: v1
kind: Config
current-context: nowhere
clusters: [{name: nowhere, cluster: {server: "http://127.0.0.1:1"}}]
contexts: [{name: nowhere, context: {cluster: nowhere, user: nobody}}]
users: [{name: nobody, user: {}}]
"""


@dataclass
class Told:
    """A reconciler that notes what it is told, and fails where it is told to."""

    faults: dict[str, Exception] = field(default_factory=dict)
    calls: list[str] = field(default_factory=list)
    left_s: list[float] = field(default_factory=list)
    hangs: asyncio.Event | None = None

    async def reconcile(self, ref: ObjectRef) -> float | None:
        self._call(f"reconcile {ref.name}")
        return None

    async def forget(self, ref: ObjectRef, last: Manifest | None) -> None:
        self._call(f"forget {ref.name} {'' if last is None else last['metadata']['uid']}")

    async def sweep(self, alive: Mapping[ObjectRef, str]) -> None:
        self._call("sweep")
        if self.hangs is not None:
            await self.hangs.wait()

    def _call(self, name: str) -> None:
        self.calls.append(name)
        self.left_s.append(left_s())
        if name in self.faults:
            raise self.faults[name]


class World:
    """A service at work, whose watches tests speak for."""

    def __init__(self, folder: Path) -> None:
        (folder / "kubeconfig").write_text(KUBECONFIG)
        self.connection: Connection = connect(
            Credentials({"KUBECONFIG": str(folder / "kubeconfig")}), ObjectRef("farm", "lease")
        )
        self.told = Told()
        self.service = Service(self.connection, self.told, Config(workers=2), Metrics())
        self.connection.memory.listeners = Listeners(self.service._changed, self.service._forgotten)
        self.service._leading = True
        self._version = 0

    def put(self, ref: ObjectRef, uid: str) -> None:
        self.connection.memory.put(FLEETS, self._body(ref, uid))

    def drop(self, ref: ObjectRef, uid: str) -> None:
        self.connection.memory.drop(FLEETS, self._body(ref, uid))

    def _body(self, ref: ObjectRef, uid: str) -> Manifest:
        self._version += 1
        metadata = {"namespace": ref.namespace, "name": ref.name, "uid": uid, "generation": 1}
        return {
            "apiVersion": "fleetcomputer.io/v1alpha1",
            "kind": "FleetSpec",
            "metadata": metadata | {"resourceVersion": str(self._version)},
            "spec": {},
        }


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path)


def test_a_fleetspec_that_is_made_again_is_looked_at_though_the_old_ones_data_stays(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    world.put(CROP, "old")
    world.drop(CROP, "old")
    world.put(CROP, "new")
    world.told.faults["forget crop old"] = StorageUnavailable("no DataNode answers")
    with caplog.at_level(logging.WARNING):
        asyncio.run(world.service._pass(CROP))
        asyncio.run(world.service._pass(CROP))
    assert world.told.calls == ["forget crop old", "reconcile crop", "reconcile crop"]
    assert "what an earlier one of this name left behind was not cleaned up: no DataNode answers" in caplog.text


@pytest.mark.parametrize("error", [StorageUnavailable("away"), SpecError([])])
def test_what_a_fleetspec_left_is_tried_again_while_there_is_no_other_one(world: World, error: Exception) -> None:
    world.put(CROP, "old")
    world.drop(CROP, "old")
    world.told.faults["forget crop old"] = error
    with pytest.raises(type(error)):
        asyncio.run(world.service._pass(CROP))
    world.told.faults.clear()
    asyncio.run(world.service._pass(CROP))
    assert world.told.calls == ["forget crop old"] * 2


def test_a_cluster_that_does_not_answer_is_no_reason_to_go_on(world: World) -> None:
    world.put(CROP, "old")
    world.drop(CROP, "old")
    world.put(CROP, "new")
    world.told.faults["forget crop old"] = Unavailable("the API server is away")
    with pytest.raises(Unavailable):
        asyncio.run(world.service._pass(CROP))
    assert world.told.calls == ["forget crop old"]


def test_no_pass_waits_for_storages_as_long_as_one_that_hangs(world: World) -> None:
    world.put(CROP, "new")
    asyncio.run(world.service._pass(CROP))
    assert PASS_STORAGE_S < LONGEST_PASS_S
    assert all(0 < left < LONGEST_PASS_S for left in world.told.left_s)
    assert left_s() == float("inf")


def test_fleets_are_worked_on_while_a_sweep_hangs_and_it_is_repeated(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SWEEP_S", 0.0)
    monkeypatch.setattr(module, "SWEEP_AGAIN_S", (0.0, 0.0))

    async def nothing() -> None:
        """In place of a list from the API server."""

    monkeypatch.setattr(world.connection.watches, "refresh_fleets", nothing)

    async def scenario() -> None:
        world.told.hangs = asyncio.Event()
        world.put(CROP, "one")
        working = asyncio.create_task(world.service._work())
        async with asyncio.timeout(30.0):
            while "reconcile crop" not in world.told.calls:
                await asyncio.sleep(0.001)
            assert world.told.calls.count("sweep") == 1
            world.told.faults["sweep"] = StorageUnavailable("away")
            world.told.hangs.set()
            for fault, count in ((ValueError("a fault of the program"), 3), (None, 5)):
                while world.told.calls.count("sweep") < count:
                    await asyncio.sleep(0.001)
                world.told.faults = {} if fault is None else {"sweep": fault}
        assert not working.done()
        working.cancel()
        await asyncio.gather(working, return_exceptions=True)

    asyncio.run(scenario())

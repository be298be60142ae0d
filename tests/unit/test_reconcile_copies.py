"""A storage that keeps fewer copies than it is asked for is told of, and stops no fleet."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from fleet.errors import StorageError, StorageUnavailable
from fleet.storage.port import Storage
from fleet_operator.reconcile.copies import EVERY_S, Copies
from fleet_operator.reconcile.fence import fenced
from tests.reconciled import Reconciled, WatchedStorage

FEWER = "webhdfs://namenode/fleet keeps 1 of 2 copies of what it has acknowledged; start 2 DataNodes"


@dataclass(frozen=True)
class Careless(WatchedStorage):
    """A storage of which the copies can be checked.

    Args:
        errors: What each check raises, the last for ever; none when all is well.
        checks: The checks that were made.
    """

    errors: tuple[StorageError, ...] = ()
    checks: list[str] = field(default_factory=list)

    def check_copies(self) -> None:
        self.checks.append(self.uri)
        if self.errors:
            raise self.errors[min(len(self.checks), len(self.errors)) - 1]


@pytest.fixture
def run(tmp_path: Path, quick_disk: None) -> Reconciled:
    return Reconciled(tmp_path)


def careless(run: Reconciled, *errors: StorageError) -> Careless:
    """Have the fleet's storage be one of which the copies can be checked."""
    storage = Careless(run.storage, lambda name: None, errors=errors)
    run.opened = fenced(lambda uri: storage, lambda: 10.0)
    run.restart()
    return storage


def told(run: Reconciled) -> list[tuple[str, str, str]]:
    return [event for event in run.cluster.events if event[1] == "FewerCopies"]


def test_fewer_copies_are_an_event_and_nothing_else(run: Reconciled) -> None:
    storage = careless(run, StorageError(FEWER))
    run.ask()
    assert run.settle()[-1] == "Done"
    assert told(run) == [("Warning", "FewerCopies", FEWER)]
    assert len(storage.checks) == 1
    assert (run.conditions()["Degraded"], run.conditions()["Stalled"]) == (("False", "NoTrouble"), ("False", "GoesOn"))


def test_a_storage_that_keeps_them_is_not_spoken_of(run: Reconciled) -> None:
    storage = careless(run)
    run.ask()
    run.settle()
    assert (told(run), len(storage.checks)) == ([], 1)


def test_a_storage_that_cannot_be_checked_now_stops_nothing(run: Reconciled) -> None:
    careless(run, StorageUnavailable("the NameNode does not answer"))
    run.ask()
    assert run.settle()[-1] == "Done"
    assert told(run) == []


def test_a_storage_is_checked_once_an_hour_however_many_fleets_it_has(run: Reconciled) -> None:
    storage: Storage = careless(run, StorageError(FEWER), StorageError("now 0"))
    copies = Copies()

    async def ask(now_s: float) -> list[str | None]:
        return await asyncio.gather(*(copies.complaint(storage, now_s) for _ in range(3)))

    assert asyncio.run(ask(0.0)) == [FEWER, None, None]
    assert asyncio.run(ask(EVERY_S - 1.0)) == [FEWER, FEWER, FEWER]
    assert asyncio.run(ask(EVERY_S)) == ["now 0", None, None]


def test_a_folder_keeps_no_copies(run: Reconciled) -> None:
    assert asyncio.run(Copies().complaint(run.storage, 0.0)) == ""

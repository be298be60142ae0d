"""A storage that does not answer is asked less and less often, and at once again when it has answered."""

from __future__ import annotations

from pathlib import Path

import pytest

from fleet.errors import StorageUnavailable
from tests.reconciled import Reconciled


@pytest.fixture
def run(tmp_path: Path, quick_disk: None) -> Reconciled:
    return Reconciled(tmp_path)


def refuse(name: str) -> None:
    raise StorageUnavailable("the NameNode does not answer")


def waits(run: Reconciled, passes: int) -> list[float | None]:
    """What the passes ask for, when each comes as late as the one before has asked for."""
    found = []
    for _ in range(passes):
        run.look()
        found.append(run.later)
        run.cluster.clock.sleep(run.later or 0.0)
    return found


def test_the_longer_a_storage_is_away_the_later_it_is_asked_again(run: Reconciled) -> None:
    run.ask()
    run.before_storage = refuse
    assert waits(run, 9) == [10.0, 10.0, 20.0, 40.0, 80.0, 160.0, 300.0, 300.0, 300.0]


def test_events_in_between_make_no_wait_longer(run: Reconciled) -> None:
    run.ask()
    run.before_storage = refuse
    for _ in range(20):
        run.look()
    assert run.later == 10.0


def test_a_storage_that_has_answered_is_asked_soon_when_it_is_away_again(run: Reconciled) -> None:
    run.ask()
    run.before_storage = refuse
    assert waits(run, 5)[-1] == 80.0
    run.before_storage = lambda name: None
    run.settle(until="Flying")
    run.before_storage = refuse
    assert waits(run, 1) == [10.0]

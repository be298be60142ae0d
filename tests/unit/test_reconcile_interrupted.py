"""An operator that is killed at any call: the next one comes to the same end."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from fleet.storage.local import LocalStorage
from tests.memory_cluster import Broken
from tests.reconciled import Reconciled


def test_an_operator_that_is_killed_at_any_call_comes_to_the_same_end(tmp_path: Path, quick_disk: None) -> None:
    folder = tmp_path / "run"
    whole = undisturbed(folder)
    expected = whole.picture()
    for last in range(1, len(whole.cluster.calls) + len(whole.storage_calls) + 1):
        shutil.rmtree(folder)
        assert killed_at(folder, last).picture() == expected, f"killed at call {last}"


def undisturbed(folder: Path) -> Reconciled:
    run = Reconciled(folder)
    run.ask()
    run.settle()
    assert run.phase == "Done"
    return run


def killed_at(folder: Path, last: int) -> Reconciled:
    """A run whose operator is killed when it makes its call number `last`, and started anew."""
    run = Reconciled(folder)
    left = last

    def count(name: str) -> None:
        nonlocal left
        left -= 1
        if left == 0:
            raise Broken(name)

    run.cluster.before_call = run.before_storage = count
    run.ask()
    try:
        run.settle()
    except Broken:
        run.restart()
        run.settle()
    assert left <= 0
    return run


@pytest.mark.parametrize("phase", ["Training", "Flying", "Retraining", "Weighing"])
def test_a_new_operator_in_the_middle_of_a_phase_writes_nothing_anew(tmp_path: Path, phase: str) -> None:
    run = Reconciled(tmp_path)
    run.ask()
    run.settle(until=phase)
    before, stored = run.picture(), LocalStorage(tmp_path / "storage").list("")
    run.restart()
    made = len(run.cluster.calls)
    run.look()
    assert run.picture() == before
    assert LocalStorage(tmp_path / "storage").list("") == stored
    assert run.cluster.calls[made:] == []

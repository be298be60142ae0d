"""An operator that is killed at any call: the next one comes to the same end."""

from __future__ import annotations

import random
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from fleet.storage.local import LocalStorage
from tests.fleet_runs import FUNCTIONS
from tests.memory_cluster import Broken
from tests.reconciled import Reconciled

Act = Callable[[Reconciled], object]
FELL = "Job has reached the specified backoff limit"
FAULTS = {"plots-m0001-sensor-agent-1": FELL, "plots-m0001-aggregator-1": FELL, "plots-m0001-aggregator-2": ""}
ALL_FELL = {f"plots-m0001-workflow-agent-{number}": FELL for number in (1, 2)}


def write_functions(run: Reconciled) -> None:
    (run.folder / "library" / "plots" / "own.py").write_text(f"{FUNCTIONS}\nMENDED = True\n")


def change(run: Reconciled) -> None:
    write_functions(run)
    run.ask(goals=[{"metric": "accuracy", "atLeast": 0.9}])


LIVES: dict[str, tuple[int, list[Act]]] = {
    "plain": (3, [Reconciled.ask, Reconciled.settle]),
    "with failures": (5, [Reconciled.ask, lambda run: run.settle(FAULTS)]),
    "with a change in flight": (
        5,
        [Reconciled.ask, lambda run: run.settle(until="Retraining"), change, Reconciled.settle],
    ),
    "with a mission that is flown again": (
        7,
        [lambda run: run.ask(missions={"count": 1}), lambda run: run.settle(ALL_FELL), change, Reconciled.settle],
    ),
}
"""What happens to a fleet, and how many of its calls there are to one at which the operator is killed here."""


@pytest.mark.parametrize("life", LIVES)
def test_an_operator_that_is_killed_at_any_call_comes_to_the_same_end(
    tmp_path: Path, quick_disk: None, life: str
) -> None:
    folder = tmp_path / "run"
    stride, acts = LIVES[life]
    whole = lived(folder, acts, 0)
    expected, calls = whole.picture(), len(whole.cluster.calls) + len(whole.storage_calls)
    for last in range(1 + random.Random(life).randrange(stride), calls + 1, stride):
        shutil.rmtree(folder)
        assert lived(folder, acts, last).picture() == expected, f"killed at call {last} of {calls}"


def lived(folder: Path, acts: Sequence[Act], last: int) -> Reconciled:
    """A fleet whose operator is killed when it makes its call number `last`, and started anew; 0 for never."""
    run = Reconciled(folder)
    left = last

    def count(name: str) -> None:
        nonlocal left
        left -= 1
        if left == 0:
            raise Broken(name)

    run.cluster.before_call = run.before_storage = count
    for act in acts:
        try:
            act(run)
        except Broken:
            run.restart()
            act(run)
    assert left < 0 or not last
    assert run.phase == "Done"
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

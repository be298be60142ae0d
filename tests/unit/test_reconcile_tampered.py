"""User code can write to the storage of its fleet: what it leaves there does not lead the operator astray."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.reconciled import PATHS, Reconciled

WORKFLOW = "plots-m0001-workflow-agent-2"
Change = Callable[[dict[str, Any]], None]


@pytest.fixture
def run(tmp_path: Path, quick_disk: None) -> Reconciled:
    """A fleet in flight, whose operator has just started and knows nothing of it."""
    run = Reconciled(tmp_path)
    run.ask(missions={"count": 1})
    run.settle(until="Flying")
    run.restart()
    return run


def tamper(run: Reconciled, path: str, change: Change) -> None:
    document = json.loads(run.storage.read(path))
    change(document)
    run.storage.write(path, json.dumps(document).encode())


def namespaces(run: Reconciled) -> set[str]:
    return {ref.namespace for _, ref in run.cluster.objects}


def test_objects_are_made_in_the_fleets_own_namespace_and_name_whatever_storage_says(run: Reconciled) -> None:
    tamper(
        run, PATHS.fleet_spec, lambda document: document["metadata"].update(namespace="kube-system", name="kube-proxy")
    )
    run.cluster.end_job(WORKFLOW, "it fails, and something new is to be made")
    before = len(run.cluster.objects)
    assert run.settle()[-1] == "Done"
    assert len(run.cluster.objects) > before
    assert namespaces(run) == {"default"}
    assert {name for name in run.names("Job") if not name.startswith("plots-")} == set()


def with_functions(run: Reconciled, files: dict[str, bytes]) -> None:
    """Functions with a digest that is right: whoever writes the one can write the other."""
    encoded = {path: base64.b64encode(data).decode() for path, data in files.items()}
    tamper(run, PATHS.functions, lambda document: document.update(files=encoded))


@pytest.mark.parametrize("escape", ["{outside}/own.py", "a/../../../../../../../..{outside}/own.py"])
def test_functions_in_storage_are_never_written_outside_of_their_folder(
    run: Reconciled, tmp_path: Path, escape: str
) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    with_functions(run, {escape.format(outside=outside): b"x = 1\n"})
    run.cluster.end_job(WORKFLOW, "so that a landing is to be written, with the energy of the fleet's profiles")
    run.look()
    assert run.conditions()["Degraded"] == ("True", "StorageUnavailable")
    assert "functions.json" in run.message("Degraded")
    assert list(outside.iterdir()) == []


@pytest.mark.parametrize("document", [{}, [], {"files": []}, {"files": {"own.py": 1}}, {"files": {"own.py": "x"}}])
def test_damaged_functions_are_told_and_heal(run: Reconciled, document: object) -> None:
    whole = run.storage.read(PATHS.functions)
    run.storage.write(PATHS.functions, json.dumps(document).encode())
    run.look()
    assert run.conditions()["Degraded"] == ("True", "StorageUnavailable")
    assert "functions.json" in run.message("Degraded")
    run.storage.write(PATHS.functions, whole)
    run.restart()
    assert run.settle()[-1] == "Done"


@pytest.mark.parametrize(
    ("part", "field", "value"),
    [
        ("agents", "energyProfile", "/dev/zero#p"),
        ("workflow", "edgeProfile", "../../../etc/passwd#p"),
        ("workflow", "edgeProfile", "x://../../../dev/zero#p"),
        ("sa", "pretrained", "/etc/passwd"),
    ],
)
def test_files_outside_that_the_stored_fleetspec_names_are_not_read(
    run: Reconciled, part: str, field: str, value: str
) -> None:
    tamper(run, PATHS.fleet_spec, lambda document: document["spec"][part].update({field: value}))
    run.cluster.end_job(WORKFLOW, "so that a landing is to be written, with the energy of the fleet's profiles")
    run.look()
    assert run.conditions()["Degraded"] == ("True", "StorageUnavailable")
    assert "is not below the folder of the FleetSpec" in run.message("Degraded")


@pytest.mark.parametrize("text", [b"[" * 200_000, b"{}", b"\xff", b"null"], ids=["deep", "empty", "no text", "null"])
def test_a_fleetspec_that_is_none_is_told(run: Reconciled, text: bytes) -> None:
    run.storage.write(PATHS.fleet_spec, text)
    run.look()
    assert run.conditions()["Degraded"] == ("True", "StorageUnavailable")
    assert "is no FleetSpec of this version" in run.message("Degraded")

"""What kubectl and Helm make of the status of fleets and missions on a real API server."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fleet.spec.resources import FleetSpec
from fleet.spec.yaml_text import write_yaml
from fleet_operator.compiler.missions import mission_manifest
from fleet_operator.compiler.target import Target
from fleet_operator.policy.mission_status import mission_status
from fleet_operator.policy.status import fleet_status, status_manifest
from tests.api_client import ApiClient, Manifest
from tests.conftest import ROOT
from tests.situations import BROKEN, MISSIONS, SITUATIONS
from tests.spec_documents import fleet_document
from tests.testbed.binaries import tool
from tests.testbed.control_plane import ControlPlane
from tests.testbed.requirements import need
from tests.testbed.waiting import wait_for

pytestmark = pytest.mark.xdist_group("control-plane")
NAMESPACE = "statuses"
FOLDER = f"/apis/fleetcomputer.io/v1alpha1/namespaces/{NAMESPACE}"


@pytest.fixture(scope="module")
def plane(control_plane: ControlPlane) -> Iterator[ControlPlane]:
    """A control plane with a FleetSpec and a Mission."""
    for name in ("fleetspecs", "missions"):
        control_plane.kubectl("apply", "--server-side", "--force-conflicts", "-f", str(ROOT / "crds" / f"{name}.yaml"))
    control_plane.kubectl("wait", "--for=condition=Established", "crd", "--all")
    control_plane.kubectl("create", "namespace", NAMESPACE)
    document = fleet_document(missions={"count": 3})
    document["metadata"]["namespace"] = NAMESPACE
    control_plane.apply(document, mission_manifest(Target(FleetSpec.model_validate(document)), 1))
    yield control_plane
    control_plane.kubectl("delete", "namespace", NAMESPACE, "--wait=false")


def set_status(plane: ControlPlane, plural: str, name: str, status: Manifest) -> Manifest:
    """Apply a status as the operator does; what the server keeps of it."""
    kind = {"fleetspecs": "FleetSpec", "missions": "Mission"}[plural]
    document = {"apiVersion": "fleetcomputer.io/v1alpha1", "kind": kind, "metadata": {"name": name}, "status": status}
    path = f"{FOLDER}/{plural}/{name}/status?fieldManager=fleet-operator&force=true&fieldValidation=Strict"
    code, answer = ApiClient(plane).call("PATCH", path, document, "apply-patch+yaml")
    assert code == 200, answer
    kept: Manifest = answer["status"]
    return kept


def fleet_document_of(situation: str) -> Manifest:
    return status_manifest(fleet_status(replace(SITUATIONS[situation], generation=1), None))


def table(text: str) -> list[list[str]]:
    """Cells of what `kubectl get` prints, without the age."""
    return [line.split()[:-1] for line in text.splitlines()]


def test_the_server_keeps_every_status_whole(plane: ControlPlane) -> None:
    for name in SITUATIONS:
        status = fleet_document_of(name)
        assert set_status(plane, "fleetspecs", "crops", status) == status
    for situation in MISSIONS.values():
        status = status_manifest(mission_status(situation, None))
        assert set_status(plane, "missions", "crops-m0001", status) == status


def test_what_kubectl_get_shows(plane: ControlPlane) -> None:
    set_status(plane, "fleetspecs", "crops", fleet_document_of("flying the second mission"))
    set_status(plane, "missions", "crops-m0001", status_manifest(mission_status(MISSIONS["over"], None)))
    shown = plane.kubectl("get", "fleets,missions", "-n", NAMESPACE).split("\n\n")
    assert [table(part) for part in shown] == [
        [
            ["NAME", "PHASE", "MISSIONS", "COVERAGE", "ACCURACY", "GOALS"],
            ["fleetspec.fleetcomputer.io/crops", "Flying", "1/3", "0.250", "0.800", "2/2"],
        ],
        [
            ["NAME", "FLEET", "NUMBER", "PHASE", "LANDED", "COVERAGE", "ACCURACY", "GOALS"],
            ["mission.fleetcomputer.io/crops-m0001", "crops", "1", "Succeeded", "2/2", "0.250", "0.800", "2/2"],
        ],
    ]
    wide = table(plane.kubectl("get", "fleet", "crops", "-n", NAMESPACE, "-o", "wide"))
    cells = dict(zip(wide[0], wide[1], strict=False))
    assert (cells["READY"], cells["DEGRADED"]) == ("True", "False")


@pytest.mark.parametrize(
    ("situation", "waits_for", "comes"),
    [
        ("done", "condition=GoalsMet", True),
        ("done", "jsonpath={.status.phase}=Done", True),
        ("done, goals missed", "condition=GoalsMet", False),
        ("training", "condition=Ready", False),
        ("suspended", "condition=Ready", True),
        ("the trainer is broken", "condition=Stalled", True),
    ],
)
def test_kubectl_wait(plane: ControlPlane, situation: str, waits_for: str, comes: bool) -> None:
    set_status(plane, "fleetspecs", "crops", fleet_document_of(situation))
    wait = ("wait", f"--for={waits_for}", "fleetspec/crops", "-n", NAMESPACE, "--timeout=0s")
    assert (plane.try_kubectl(*wait).returncode == 0) == comes


def test_a_status_changes_neither_the_spec_nor_its_generation(plane: ControlPlane) -> None:
    document = fleet_document(missions={"count": 3})
    document["metadata"]["namespace"] = NAMESPACE
    diff = plane.try_kubectl("diff", "--server-side", "-f", "-", stdin=write_yaml(document))
    assert (diff.returncode, diff.stdout) == (0, "")
    assert plane.get("fleetspec", "crops", "-n", NAMESPACE)["metadata"]["generation"] == 1


@pytest.mark.parametrize(
    ("situations", "code", "says"),
    [
        (("shaping", "ordering the first mission"), 0, "STATUS: deployed"),
        (("shaping", "the trainer is broken"), 1, BROKEN),
    ],
)
def test_helm_waits_until_a_fleet_is_ready_or_stalled(
    plane: ControlPlane, tmp_path: Path, situations: tuple[str, ...], code: int, says: str
) -> None:
    need("helm")
    name = f"helm-{code}"
    document: dict[str, Any] = fleet_document(missions={"count": 3})
    document["metadata"] = {"name": name}
    (tmp_path / "templates").mkdir()
    (tmp_path / "Chart.yaml").write_text(f"apiVersion: v2\nname: {name}\nversion: 0.1.0\n")
    (tmp_path / "templates" / "fleet.yaml").write_text(write_yaml(document))
    command = [str(tool("helm")), "install", name, str(tmp_path), "--wait", "--timeout=60s", "-n", NAMESPACE]
    with subprocess.Popen(
        [*command, "--kubeconfig", str(plane.kubeconfig)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as helm:
        api = ApiClient(plane)
        wait_for("the FleetSpec of the chart", lambda: api.call("GET", f"{FOLDER}/fleetspecs/{name}")[0] == 200)
        for situation in situations:
            assert helm.poll() is None
            set_status(plane, "fleetspecs", name, fleet_document_of(situation))
        words, _ = helm.communicate(timeout=70)
    assert (helm.returncode, says in words) == (code, True), words

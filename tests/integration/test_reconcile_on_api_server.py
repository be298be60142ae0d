"""The operator on a real API server: pods are stand-ins, storage is a folder, everything else is real."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fleet.storage.layout import FleetPaths
from fleet.storage.local import LocalStorage
from fleet_operator.compiler.fleet import priority_classes
from fleet_operator.flow.files import collect, to_config_maps
from fleet_operator.resources import names
from tests.conftest import ROOT
from tests.fleet_runs import spec_document, write_application
from tests.testbed.control_plane import ControlPlane, control_plane
from tests.testbed.processes import Program
from tests.testbed.requirements import need
from tests.testbed.stand_in_kubelet import stand_in_kubelet
from tests.testbed.waiting import wait_for

pytestmark = pytest.mark.xdist_group("reconcile")
FLEET = "plots"


class Site:
    """A control plane with stand-in kubelets and an operator.

    Args:
        folder: Of storage, files and logs.
    """

    def __init__(self, plane: ControlPlane, folder: Path) -> None:
        self.plane = plane
        self.folder = folder
        self.storage = LocalStorage(folder / "storage")
        self.operator = Program(
            [sys.executable, "-m", "fleet_operator"],
            folder / "operator.log",
            {
                "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "operator")]),
                "KUBECONFIG": str(plane.kubeconfig),
                "FLEET_OPERATOR_NAMESPACE": "default",
                "FLEET_OPERATOR_STORAGE_URI": self.storage.uri,
                "FLEET_OPERATOR_LIBRARY": str(folder / "library"),
                "FLEET_OPERATOR_HEALTH_PORT": "0",
                "FLEET_OPERATOR_IDENTITY": "operator",
            },
        )

    def namespace(self, name: str) -> None:
        """Make a namespace."""
        self.plane.kubectl("create", "namespace", name)

    def apply_files(self, namespace: str) -> None:
        """What `fleet files | kubectl apply` does."""
        from fleet.cli.inputs import read_spec  # noqa: PLC0415 - it is only here that a file is read

        file = write_application(self.folder / "files" / namespace)
        for manifest in to_config_maps(FLEET, collect(read_spec(file), file.parent)):
            manifest["metadata"]["namespace"] = namespace
            self.plane.apply(manifest)

    def apply(self, namespace: str, **changes: Any) -> None:
        """What `kubectl apply -f fleetspec.yaml` does."""
        document = spec_document(**changes)
        document["metadata"]["namespace"] = namespace
        self.plane.apply(document)

    def fleet(self, namespace: str) -> dict[str, Any]:
        """The FleetSpec."""
        found: dict[str, Any] = self.plane.get("fleetspec", FLEET, "-n", namespace)
        return found

    def wait(self, namespace: str, condition: str) -> None:
        """`kubectl wait` until a condition is True."""
        self.plane.kubectl(
            "wait", f"--for=condition={condition}", f"fleetspec/{FLEET}", "-n", namespace, "--timeout=90s"
        )

    def wait_phase(self, namespace: str, phase: str) -> None:
        """Wait until a fleet is in a phase."""
        wait_for(
            f"{namespace} is {phase}", lambda: self.fleet(namespace).get("status", {}).get("phase") == phase, 90.0, 0.2
        )

    def events(self, namespace: str) -> set[str]:
        """Reasons of the events of the FleetSpec."""
        items = self.plane.get("events", "-n", namespace)["items"]
        return {each["reason"] for each in items if each["involvedObject"]["kind"] == "FleetSpec"}

    def left(self, namespace: str) -> list[str]:
        """What there is of a fleet."""
        kinds = "fleetspecs,missions,jobs,services,networkpolicies,configmaps"
        listed = self.plane.kubectl("get", kinds, "-n", namespace, "-l", f"{names.FLEET_LABEL}={FLEET}", "-o", "name")
        return listed.split()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    need("openssl", "setpriv", "etcd", "kube-apiserver", "kube-controller-manager", "kubectl")
    folder = tmp_path_factory.mktemp("site")
    with control_plane(folder / "plane") as plane:
        for crd in sorted((ROOT / "crds").glob("*.yaml")):
            plane.kubectl("apply", "--server-side", "-f", str(crd))
        plane.apply(*priority_classes())
        plane.kubectl("wait", "--for=condition=Established", "crd", "--all")
        with stand_in_kubelet(plane.kubeconfig, folder / "kubelet"):
            place = Site(plane, folder)
            place.operator.start()
            try:
                yield place
            finally:
                place.operator.stop()


def test_a_fleet_with_its_files_in_configmaps_reaches_its_goals(site: Site) -> None:
    site.namespace("whole")
    site.apply("whole")
    wait_for("the refusal", lambda: "FilesMissing" in site.events("whole"), 60.0, 0.2)
    site.apply_files("whole")
    site.wait("whole", "GoalsMet")
    site.wait_phase("whole", "Done")
    missions = site.plane.get("missions", "-n", "whole")["items"]
    assert [(each["metadata"]["name"], each["status"]["phase"]) for each in missions] == [
        ("plots-m0001", "Succeeded"),
        ("plots-m0002", "Succeeded"),
    ]
    owners = {each["uid"] for mission in missions for each in mission["metadata"]["ownerReferences"]}
    assert owners == {site.fleet("whole")["metadata"]["uid"]}
    told = {"Compiled", "Training", "Shaped", "Trained", "MissionOrdered", "GoalsMet", "Retraining", "Weighing", "Done"}
    assert site.events("whole") == {*told, "FilesMissing"}


def test_a_fleet_that_is_deleted_in_flight_and_made_again_at_once_starts_afresh(site: Site) -> None:
    site.namespace("again")
    site.apply_files("again")
    paths = FleetPaths("again", FLEET)
    site.storage.write(f"{paths.root}/faults/workflow/agent-1.json", json.dumps({"sleep": 60}).encode())
    site.apply("again", storage={"onDelete": "Delete"})
    site.wait_phase("again", "Flying")
    wait_for("a log", lambda: site.storage.exists(paths.log(1, "agent-2")))
    before = site.fleet("again")["metadata"]["uid"]
    site.plane.kubectl("delete", "fleetspec", FLEET, "-n", "again")
    site.apply("again", storage={"onDelete": "Delete"}, missions={"count": 1})
    site.wait_phase("again", "Done")
    assert site.fleet("again")["metadata"]["uid"] != before
    assert not {"Adopted", "Rejected"} & site.events("again")
    assert len(site.plane.get("missions", "-n", "again")["items"]) == 1
    site.plane.kubectl("delete", "fleetspec", FLEET, "-n", "again")
    wait_for("nothing is left of it", lambda: not site.left("again") and not site.storage.list(paths.root))
    assert not site.storage.exists(paths.claim)


def test_a_mission_goes_on_without_an_agent_and_an_aggregator_that_fail(site: Site) -> None:
    site.namespace("faults")
    site.apply_files("faults")
    paths = FleetPaths("faults", FLEET)
    for program in ("workflow/agent-2", "aggregator/1"):
        site.storage.write(f"{paths.root}/faults/{program}.json", json.dumps({"code": 65}).encode())
    site.apply("faults", missions={"count": 1})
    site.wait_phase("faults", "Done")
    assert {"AgentFailed", "Done"} <= site.events("faults")
    degraded = next(each for each in site.fleet("faults")["status"]["conditions"] if each["type"] == "Degraded")
    assert (degraded["status"], degraded["reason"]) == ("True", "AgentFailed")
    assert "exit code 65" in degraded["message"]
    assert not site.storage.exists(paths.retraining(1, "1"))
    assert site.storage.exists(paths.weights(2))

"""Every right that the chart gives to the operator is used, and none is missing: by the API server's audit log.

A fleet goes through all phases, and through all that makes the operator use a right which it seldom needs. Real pods
make no difference to that: fake nodes run stand-ins.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml

from fleet.cli import inputs
from fleet.storage.layout import FleetPaths
from fleet.storage.local import LocalStorage
from fleet_operator.flow.files import collect, to_config_maps
from tests.chart import NAMESPACE, RELEASE, ROOT, Helm, Manifest
from tests.fleet_runs import write_application
from tests.testbed.control_plane import ControlPlane, control_plane
from tests.testbed.faults import Fault, Moment
from tests.testbed.ports import Ports
from tests.testbed.processes import Program
from tests.testbed.proxy import Proxy
from tests.testbed.requirements import need
from tests.testbed.stand_in_kubelet import stand_in_kubelet
from tests.testbed.waiting import wait_for

pytestmark = [pytest.mark.xdist_group("control-plane"), pytest.mark.slow]

FLEET, FIELDS = "plots", "fields"
ACCOUNT = f"{RELEASE}-operator"
USER = f"system:serviceaccount:{NAMESPACE}:{ACCOUNT}"
SPEC: dict[str, Any] = {
    "missions": {"count": 3, "agentRetries": 0},
    "storage": {"onDelete": "Delete"},
    "scheduling": {"cpu": "6"},
}
OF_THE_CLUSTER = {
    "ServiceAccount", "ClusterRole", "ClusterRoleBinding", "Role", "RoleBinding", "CustomResourceDefinition",
    "PriorityClass",
}  # fmt: skip
"""What the chart installs, without the operator and HDFS: the test runs those itself."""
PATIENCE_S = 180.0
Right = tuple[str, str, str]
"""API group, resource with its subresource, verb."""

APPLIED = "what server-side apply makes needs this right; the log calls the request patch"
NOT_IN_THE_LOG: dict[Right, str] = {
    ("fleetcomputer.io", "missions", "create"): APPLIED,
    ("batch", "jobs", "create"): APPLIED,
    ("", "configmaps", "create"): APPLIED,
    ("", "services", "create"): APPLIED,
    ("networking.k8s.io", "networkpolicies", "create"): APPLIED,
}


@dataclass(frozen=True)
class Site:
    """A control plane with fake nodes, and an operator with the rights of the chart and no other.

    Args:
        folder: Of the user's application.
        api: Between the operator and the API server.
        granted: What the chart's roles say.
    """

    folder: Path
    plane: ControlPlane
    api: Proxy
    storage: LocalStorage
    operator: Program
    granted: set[Right] = field(default_factory=set)

    @property
    def paths(self) -> FleetPaths:
        return FleetPaths(FIELDS, FLEET)

    def apply(self, **changes: Any) -> None:
        """What a user applies: the files beside the FleetSpec, and the FleetSpec."""
        file = write_application(self.folder, **(SPEC | changes))
        self.apply_files()
        document = yaml.safe_load(file.read_text())
        self.plane.apply(document | {"metadata": {"name": FLEET, "namespace": FIELDS}})

    def apply_files(self) -> None:
        """The files as they are now."""
        spec = inputs.read_spec(self.folder / "fleetspec.yaml")
        for manifest in to_config_maps(FLEET, collect(spec, self.folder)):
            manifest["metadata"]["namespace"] = FIELDS
            self.plane.apply(manifest)

    def go_wrong(self, role: str, **fault: float) -> None:
        """Have a stand-in go wrong, as tests/stand_in_roles.py says."""
        self.storage.write(f"{self.paths.root}/faults/{role}.json", json.dumps(fault).encode())

    def status(self) -> Manifest:
        """Of the FleetSpec."""
        status: Manifest = self.plane.get("fleetspec", FLEET, "-n", FIELDS).get("status", {})
        return status

    def degraded(self) -> str:
        """Why the fleet is degraded; "" when it is not."""
        found = [each for each in self.status().get("conditions", ()) if each["type"] == "Degraded"]
        return str(found[0]["reason"]) if found and found[0]["status"] == "True" else ""

    def wait_until(self, what: str, look: Callable[[], object]) -> None:
        """Wait; what the operator said is told when it does not come."""
        try:
            wait_for(what, lambda: bool(look()), PATIENCE_S, every_s=0.2)
        except Exception as error:
            said = self.operator.log.read_text()[-5000:]
            raise AssertionError(f"{error}\n{json.dumps(self.status(), indent=1)}\n{said}") from error


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    need("helm", "openssl", "setpriv", "etcd", "kube-apiserver", "kube-controller-manager", "kubectl")
    with ExitStack() as stack:
        plane = stack.enter_context(control_plane(tmp_path / "plane", audit=True))
        for namespace in (NAMESPACE, FIELDS):
            plane.kubectl("create", "namespace", namespace)
        manifests = [each for each in Helm(tmp_path).manifests(hooks=False) if each["kind"] in OF_THE_CLUSTER]
        plane.apply(*manifests)
        plane.kubectl("wait", "--for=condition=Established", "crd", "--all")
        api = stack.enter_context(Proxy(plane.url, plane.ca))
        stack.enter_context(stand_in_kubelet(plane.kubeconfig, tmp_path / "kubelet"))
        storage = LocalStorage(tmp_path / "storage")
        token = plane.kubectl("create", "token", ACCOUNT, "--namespace", NAMESPACE).strip()
        operator = _operator(stack, tmp_path, api.kubeconfig(tmp_path, token), storage)
        operator.start()
        stack.callback(operator.stop, 15.0)
        yield Site(tmp_path / "application", plane, api, storage, operator, _granted(manifests))


def _operator(stack: ExitStack, folder: Path, kubeconfig: Path, storage: LocalStorage) -> Program:
    ports = Ports()
    stack.callback(ports.close)
    return Program([sys.executable, "-m", "fleet_operator"], folder / "operator.log", {
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "operator")]),
        "KUBECONFIG": str(kubeconfig),
        "FLEET_OPERATOR_NAMESPACE": NAMESPACE,
        "FLEET_OPERATOR_LEASE": ACCOUNT,
        "FLEET_OPERATOR_STORAGE_URI": storage.uri,
        "FLEET_OPERATOR_HEALTH_PORT": str(ports.take()),
    })  # fmt: skip


def _granted(manifests: list[Manifest]) -> set[Right]:
    """Every right of the chart's roles; all of them are the operator's."""
    return {
        (group, resource, verb)
        for each in manifests
        if each["kind"] in {"ClusterRole", "Role"}
        for rule in each["rules"]
        for group in rule["apiGroups"]
        for resource in rule["resources"]
        for verb in rule["verbs"]
    }


def test_every_right_is_used_and_none_is_missing(site: Site) -> None:
    wait_without_pods(site)
    all_agents_fail_and_the_mission_is_flown_again(site)
    an_aggregator_gets_what_others_leave(site)
    the_functions_change(site)
    a_status_was_changed_by_somebody_else(site)
    an_event_is_posted_without_an_answer(site)
    site.wait_until("all missions to be over", lambda: site.status().get("phase") == "Done")
    site.plane.kubectl("delete", "fleetspec", FLEET, "-n", FIELDS)
    site.wait_until("the end of the data", lambda: not site.storage.list(""))

    requests = [request for request in site.plane.requests() if request.user == USER and request.resource]
    assert [f"{each.code} {each.verb} {each.path}" for each in requests if each.code in {401, 403}] == []
    assert [line for line in site.operator.log.read_text().splitlines() if "next try in" in line] == []
    used = {(request.group, request.resource, request.verb) for request in requests}
    assert used - site.granted == set()
    assert site.granted - used == set(NOT_IN_THE_LOG)


def wait_without_pods(site: Site) -> None:
    """A quota keeps the first pod from being made: the operator asks for the warnings about its Job."""
    quota = {"apiVersion": "v1", "kind": "ResourceQuota", "metadata": {"name": "none", "namespace": FIELDS}}
    site.plane.apply(quota | {"spec": {"hard": {"pods": "0"}}})
    site.apply()
    site.wait_until("the quota to be told", lambda: site.degraded() == "QuotaExceeded")
    for agent in ("agent-1", "agent-2"):
        site.go_wrong(f"workflow/{agent}", code=65, times=1)
    site.plane.kubectl("delete", "resourcequota", "none", "-n", FIELDS)


def all_agents_fail_and_the_mission_is_flown_again(site: Site) -> None:
    """Landings are written by the operator; when the user changes something, the Mission object is made anew."""
    site.wait_until("the end of a mission without agents", lambda: site.status().get("phase") == "Failed")
    site.go_wrong("aggregator/1-2", sleep=8, times=1)
    site.apply(missions={"count": 3, "agentRetries": 1})


def an_aggregator_gets_what_others_leave(site: Site) -> None:
    """One aggregator takes longer than the others: it would get their share if the fake nodes could resize pods."""
    site.wait_until("the other aggregators' end", lambda: site.storage.exists(site.paths.retraining(1, "1")))


def the_functions_change(site: Site) -> None:
    """The ConfigMap of the functions before is deleted when the next mission is ordered."""
    own = site.folder / "own.py"
    own.write_text(own.read_text() + "\nCHANGED = True\n")
    site.apply_files()


def a_status_was_changed_by_somebody_else(site: Site) -> None:
    """The API server refuses what was written over an older version: the operator reads the object and writes anew."""
    for kind in ("fleetspecs", "missions"):
        site.api.faults.append(Fault("PATCH", f"/{kind}/[^/]+/status", times=1, status=409))


def an_event_is_posted_without_an_answer(site: Site) -> None:
    """The operator posts it again, hears that it is there, and counts it up."""
    site.api.faults.append(Fault("POST", "/events", times=1, status=500, moment=Moment.AFTER))

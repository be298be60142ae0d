"""A real API server takes the CRDs and refuses what tests/contract says that it refuses, for the same reasons."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import yaml

from tests.api_client import ApiClient, Manifest
from tests.conftest import ROOT
from tests.contract import test_crd_rules as contract
from tests.contract.api_server import refusals
from tests.spec_documents import fleet_document
from tests.testbed.control_plane import ControlPlane

pytestmark = pytest.mark.xdist_group("control-plane")
GROUP = "/apis/fleetcomputer.io/v1alpha1"
NAMESPACE = "crd-rules"
FLEETS = f"{GROUP}/namespaces/{NAMESPACE}/fleetspecs"
STRICT = "?dryRun=All&fieldValidation=Strict"


@pytest.fixture(scope="module")
def api(control_plane: ControlPlane) -> Iterator[ApiClient]:
    for name in ("fleetspecs", "missions", "edgenodes"):
        control_plane.kubectl("apply", "--server-side", "--force-conflicts", "-f", str(ROOT / "crds" / f"{name}.yaml"))
    control_plane.kubectl("wait", "--for=condition=Established", "crd", "--all")
    control_plane.kubectl("create", "namespace", NAMESPACE)
    yield ApiClient(control_plane)
    control_plane.kubectl("delete", "namespace", NAMESPACE, "--wait=false")


def cases(test: Any) -> list[tuple[Any, ...]]:
    """The table of a test in tests/contract."""
    return [tuple(row) for row in test.pytestmark[0].args[1]]


def broken_rules(answer: tuple[int, Manifest]) -> list[str]:
    """Messages of the validation rules that an answer says are broken."""
    code, status = answer
    if code < 300:
        return []
    return [each["message"].removeprefix("Invalid value: ") for each in status["details"]["causes"]]


def test_the_rules_of_fleet_specs_are_those_of_the_imitation(api: ApiClient) -> None:
    table = cases(contract.test_fleet_and_kubernetes_agree_on_fleet_specs)
    found = {str(document["spec"]): broken_rules(api.call("POST", FLEETS + STRICT, document)) for document, _ in table}
    assert found == {str(document["spec"]): rules for document, rules in table}


def test_what_may_change_is_what_the_imitation_says(api: ApiClient) -> None:
    found, expected = [], []
    for before, after, rules in cases(contract.test_what_may_change_in_a_fleet_spec):
        _, made = api.call("POST", FLEETS, before)
        changed = {**after, "metadata": {**after["metadata"], "resourceVersion": made["metadata"]["resourceVersion"]}}
        found.append(broken_rules(api.call("PUT", f"{FLEETS}/crops{STRICT}", changed)))
        expected.append(rules)
        api.call("DELETE", f"{FLEETS}/crops")
    assert found == expected


def test_every_broken_spec_is_refused(api: ApiClient) -> None:
    taken = []
    for path in contract.BROKEN:
        if path.name[:2] not in contract.NOT_A_RESOURCE:
            code, _ = api.call("POST", FLEETS + STRICT, yaml.safe_load(path.read_text(encoding="utf-8")))
            taken += [path.name] if code < 400 else []
    assert taken == []


def test_missions_and_edge_nodes_are_refused_as_the_imitation_refuses_them(api: ApiClient) -> None:
    tables = (
        (
            f"{GROUP}/namespaces/{NAMESPACE}/missions",
            contract.MISSIONS,
            contract.test_fleet_and_kubernetes_agree_on_missions,
        ),
        (f"{GROUP}/edgenodes", contract.EDGE_NODES, contract.test_fleet_and_kubernetes_agree_on_edge_nodes),
    )
    for path, schema, test in tables:
        for document, _ in cases(test):
            code, answer = api.call("POST", path + STRICT, document)
            assert (code >= 400) == bool(refusals(schema, document)), (document, answer)


def test_a_schedule_that_is_none_is_refused(api: ApiClient) -> None:
    code, answer = api.call("POST", FLEETS + STRICT, fleet_document(missions={"schedule": "at six"}))
    assert (code, answer["details"]["causes"][0]["field"]) == (422, "spec.missions.schedule")


@pytest.mark.parametrize("field", ["fleetspec.spec.missions.schedule", "mission.status.landed", "edgenode.spec.mac"])
def test_kubectl_explains_fields(api: ApiClient, control_plane: ControlPlane, field: str) -> None:
    del api  # the CRDs must be there
    assert "DESCRIPTION:" in control_plane.kubectl("explain", field)

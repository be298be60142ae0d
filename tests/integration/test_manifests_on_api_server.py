"""A real API server takes every compiled object, and the pods that it makes under Pod Security `restricted`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from fleet_operator.compiler.fleet import priority_classes
from tests.api_client import ApiClient, Manifest
from tests.conftest import ROOT
from tests.testbed.control_plane import ControlPlane
from tests.testbed.waiting import wait_for

pytestmark = pytest.mark.xdist_group("control-plane")
GOLDEN = sorted((ROOT / "tests" / "golden" / "compile").glob("*.yaml"))
RESTRICTED = "pod-security.kubernetes.io/enforce=restricted"


@pytest.fixture(scope="module")
def plane(control_plane: ControlPlane) -> Iterator[ControlPlane]:
    """A control plane with the CRDs, the PriorityClasses, and the manifests' namespace."""
    for name in ("fleetspecs", "missions", "edgenodes"):
        control_plane.kubectl("apply", "--server-side", "--force-conflicts", "-f", str(ROOT / "crds" / f"{name}.yaml"))
    control_plane.kubectl("wait", "--for=condition=Established", "crd", "--all")
    control_plane.apply(*priority_classes())
    control_plane.kubectl("create", "namespace", "fields")
    control_plane.kubectl("label", "namespace", "fields", RESTRICTED)
    account = "/api/v1/namespaces/fields/serviceaccounts/default"
    wait_for("the service account of pods", lambda: ApiClient(control_plane).call("GET", account)[0] == 200)
    yield control_plane
    control_plane.kubectl("delete", "namespace", "fields", "--wait=false")


@pytest.mark.parametrize("file", GOLDEN, ids=lambda file: file.stem)
def test_the_api_server_takes_every_object_and_warns_of_none(plane: ControlPlane, file: Path) -> None:
    done = plane.try_kubectl("apply", "--dry-run=server", "--server-side", "-f", str(file))
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.count("serverside-applied (server dry run)") == len(manifests(file))


@pytest.mark.parametrize("file", GOLDEN, ids=lambda file: file.stem)
def test_the_pods_of_every_job_are_admitted(plane: ControlPlane, file: Path) -> None:
    api, refused = ApiClient(plane), []
    for job in (each for each in manifests(file) if each["kind"] == "Job"):
        name = job["metadata"]["name"]
        pod = {"apiVersion": "v1", "kind": "Pod", **job["spec"]["template"]}
        pod["metadata"] = {**pod["metadata"], "name": name}
        code, answer = api.call("POST", "/api/v1/namespaces/fields/pods?dryRun=All&fieldValidation=Strict", pod)
        refused += [] if code == 201 else [f"{name}: {answer['message']}"]
    assert refused == []


def test_a_pod_that_may_do_more_is_refused(plane: ControlPlane) -> None:
    job = next(each for each in manifests(GOLDEN[0]) if each["kind"] == "Job")
    pod = {"apiVersion": "v1", "kind": "Pod", **job["spec"]["template"], "metadata": {"name": "more"}}
    pod["spec"] = {**pod["spec"], "hostNetwork": True}
    code, answer = ApiClient(plane).call("POST", "/api/v1/namespaces/fields/pods?dryRun=All", pod)
    assert (code, "hostNetwork" in answer["message"]) == (403, True)


def manifests(file: Path) -> list[Manifest]:
    return list(yaml.safe_load_all(file.read_text(encoding="utf-8")))

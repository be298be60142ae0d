"""The chart on a real API server by a real helm: install, upgrade, roll back, uninstall."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
import yaml

from tests.chart import BED_VALUES, CHART, NAMESPACE, PREVIOUS_CHART, RELEASE, ROOT, WORKLOADS, Helm, Manifest, pod_of
from tests.testbed.control_plane import ControlPlane, control_plane
from tests.testbed.requirements import need
from tests.testbed.waiting import wait_for

pytestmark = [pytest.mark.xdist_group("control-plane"), pytest.mark.slow]

EXAMPLE = ROOT / "examples/crop-scouting/fleetspec.yaml"
VALUES = ROOT / "tests/golden/chart"
FIELDS = ["--namespace", NAMESPACE]
OLD_FLEET = {
    "apiVersion": "fleetcomputer.io/v1alpha1",
    "kind": "FleetSpec",
    "metadata": {"name": "from-before", "namespace": "default"},
    "spec": {
        "agents": {"count": 2},
        "stateSpace": {"context": "field"},
        "map": {"function": "crops:map_observation"},
        "eval": {"function": "crops:evaluate"},
        "contexts": [{"name": "field", "uri": "contexts/field", "use": ["Shaping", "Training", "Mission"]}],
        "goals": [{"metric": "accuracy", "atLeast": 0.5}],
    },
}
KEPT = {"edgenodes.fleetcomputer.io", "fleetspecs.fleetcomputer.io", "missions.fleetcomputer.io"}


NEEDS = ("helm", "openssl", "setpriv", "etcd", "kube-apiserver", "kube-controller-manager", "kubectl")


@pytest.fixture(scope="module")
def plane(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ControlPlane]:
    """A control plane of this module's own: the chart brings what belongs to a whole cluster."""
    need(*NEEDS)
    with control_plane(tmp_path_factory.mktemp("chart-cluster")) as plane:
        for namespace in (NAMESPACE, "fields", "orchards"):
            plane.kubectl("create", "namespace", namespace)
        # helm makes it as a hook, before the pod of `helm test`; a dry run asks for it.
        plane.kubectl("create", "serviceaccount", f"{RELEASE}-test", *FIELDS)
        yield plane


@pytest.fixture
def helm(plane: ControlPlane, tmp_path: Path) -> Iterator[Helm]:
    """helm on the cluster; the release is gone afterwards, but for what it keeps."""
    helm = Helm(tmp_path, plane.kubeconfig)
    yield helm
    helm.attempt("uninstall", RELEASE, *FIELDS)


def contents(plane: ControlPlane) -> dict[str, Any]:
    """`spec` or `data` of the release's objects, by kind and name; of a Job the name, which has a hash of the rest."""
    kinds = "deployments,statefulsets,daemonsets,services,pdb,networkpolicies,configmaps,jobs"
    found = plane.get(kinds, *FIELDS, "--selector", f"app.kubernetes.io/instance={RELEASE}")["items"]
    return {
        f"{each['kind']}/{each['metadata']['name']}": each.get("spec", each.get("data"))
        if each["kind"] != "Job"
        else ""
        for each in found
    }


def crds(plane: ControlPlane) -> set[str]:
    return {each["metadata"]["name"] for each in plane.get("crd")["items"]}


def test_a_release_is_installed_upgraded_rolled_back_and_uninstalled_and_its_resources_outlive_it(
    plane: ControlPlane, helm: Helm
) -> None:
    helm("install", RELEASE, CHART, *FIELDS)
    plane.kubectl("apply", "--server-side", "-f", str(EXAMPLE))
    first = contents(plane)
    helm("upgrade", RELEASE, CHART, *FIELDS)
    assert contents(plane) == first, "an upgrade to the same changes nothing"

    helm("upgrade", RELEASE, CHART, *FIELDS, "--set", "hdfs.root=/swarms,operator.replicas=2,hdfs.logLevel=WARN")
    second = contents(plane)
    assert second[f"Deployment/{RELEASE}-operator"]["replicas"] == 2
    assert [name for name in second if name.startswith("Job/")] != [name for name in first if name.startswith("Job/")]
    helm("rollback", RELEASE, "1", *FIELDS)
    assert contents(plane) == first

    helm("uninstall", RELEASE, *FIELDS)
    assert contents(plane) == {}
    assert crds(plane) == KEPT
    claims = [each["metadata"]["name"] for each in plane.get("pvc", *FIELDS)["items"]]
    assert claims == [f"metadata-{RELEASE}-{name}-0" for name in ("checkpoint", "namenode")]
    helm("install", RELEASE, CHART, *FIELDS)
    assert plane.get("fleetspec", "crop-scouting")["spec"]["agents"]["count"] == 4


def test_resources_go_with_the_release_when_that_is_wanted(plane: ControlPlane, helm: Helm) -> None:
    helm("install", RELEASE, CHART, *FIELDS, "--set", "crds.keep=false")
    assert crds(plane) == KEPT
    # The API server forgets the end of a kind for five minutes, when nobody has asked for its objects yet.
    plane.kubectl("wait", "--for=condition=Established", "crd", "--all")
    for kind in KEPT:
        plane.kubectl("get", "--raw", f"/apis/fleetcomputer.io/v1alpha1/{kind.partition('.')[0]}")
    helm("uninstall", RELEASE, *FIELDS)
    wait_for("the end of the definitions", lambda: crds(plane) == set())


def test_an_upgrade_from_the_previous_chart_brings_the_new_definitions_and_keeps_the_fleets(tmp_path: Path) -> None:
    need(*NEEDS)
    with control_plane(tmp_path / "plane") as plane:
        helm = Helm(tmp_path, plane.kubeconfig)
        example = ("apply", "--dry-run=server", "--validate=strict", "-f", str(EXAMPLE))
        helm("install", RELEASE, PREVIOUS_CHART, *FIELDS, "--create-namespace")
        plane.apply(OLD_FLEET)
        assert 'unknown field "spec.missions"' in plane.try_kubectl(*example).stderr
        uid = plane.get("fleetspec", "from-before")["metadata"]["uid"]

        helm("upgrade", RELEASE, CHART, *FIELDS)
        assert "created (server dry run)" in wait_for("the definitions", lambda: plane.kubectl(*example, check=False))
        kept = plane.get("fleets", "from-before")
        assert (kept["metadata"]["uid"], kept["spec"]["agents"]["count"]) == (uid, 2)
        pod = plane.get("deployment", f"{RELEASE}-operator", *FIELDS)["spec"]["template"]["spec"]
        assert "FLEET_OPERATOR_GONE" not in {each["name"] for each in pod["containers"][0]["env"]}
        assert plane.kubectl("get", "configmap", f"{RELEASE}-gone", *FIELDS, check=False) == ""
        account = f"--as=system:serviceaccount:{NAMESPACE}:{RELEASE}-operator"
        wait_for(
            "the end of the old rights",
            lambda: plane.kubectl("auth", "can-i", "get", "secrets", account, check=False).strip() == "no",
        )


@pytest.mark.parametrize("case", ["default", "test-bed", "existing-storage", "volume", "everything-else"])
def test_the_server_takes_every_object_without_a_warning(plane: ControlPlane, helm: Helm, case: str) -> None:
    files = {"default": CHART / "values.yaml", "test-bed": BED_VALUES}
    given = ["--values", str(files.get(case, VALUES / f"{case}.values.yaml"))]
    flags = ["--server-side", "--dry-run=server", "--validate=strict", "--warnings-as-errors", *FIELDS]
    if case == "existing-storage":
        flags = flags[:-2]
    said = plane.kubectl("apply", *flags, "-f", "-", stdin=helm.render(*given))
    assert said.count("serverside-applied (server dry run)") == len(helm.manifests(*given))


def test_only_pods_with_folders_or_the_network_of_a_node_need_a_privileged_namespace(
    plane: ControlPlane, helm: Helm
) -> None:
    plane.kubectl("label", "namespace", "orchards", "pod-security.kubernetes.io/enforce=restricted", "--overwrite")
    refused = {}
    for manifest in helm.manifests():
        if manifest["kind"] not in WORKLOADS | {"Pod"}:
            continue
        pod: Manifest = {
            "apiVersion": "v1",
            "kind": "Pod",
            "metadata": {"name": "tried", "namespace": "orchards"},
            "spec": pod_of(manifest)["spec"] | {"serviceAccountName": "default", "restartPolicy": "Never"},
        }
        for claim in manifest["spec"].get("volumeClaimTemplates", []):
            name = claim["metadata"]["name"]
            pod["spec"]["volumes"].append({"name": name, "persistentVolumeClaim": {"claimName": name}})
        done = plane.try_kubectl("create", "--dry-run=server", "-f", "-", stdin=json.dumps(pod))
        refused[manifest["metadata"]["labels"]["app.kubernetes.io/component"]] = done.returncode != 0
    assert {component for component, no in refused.items() if no} == {"datanode"}
    assert set(refused) == {"operator", "namenode", "checkpoint", "datanode", "prepare", "test"}


def test_budgets_count_pods(plane: ControlPlane, helm: Helm) -> None:
    """A budget of `maxUnavailable` over a DaemonSet would fail to sync, and so refuse every eviction."""
    nodes: list[Manifest] = [
        {"apiVersion": "v1", "kind": "Node", "metadata": {"name": name, "labels": {"fleetcomputer.io/storage": "true"}}}
        for name in ("node-1", "node-2", "node-3")
    ]
    plane.apply(*nodes)
    helm("install", RELEASE, CHART, *FIELDS)

    wanted = {f"{RELEASE}-datanode": (3, 2, "InsufficientPods"), f"{RELEASE}-namenode": (1, 1, "InsufficientPods")}

    def budgets() -> dict[str, tuple[int, int, str]]:
        return {
            each["metadata"]["name"]: (
                status["expectedPods"],
                status["desiredHealthy"],
                status["conditions"][0]["reason"],
            )
            for each in plane.get("pdb", *FIELDS)["items"]
            if (status := each.get("status", {})).get("conditions")
        }

    wait_for("budgets in sync", lambda: budgets() == wanted)
    plane.kubectl("delete", "node", *(node["metadata"]["name"] for node in nodes))


def test_the_program_of_helm_test_says_what_works_and_what_does_not(
    plane: ControlPlane, helm: Helm, tmp_path: Path
) -> None:
    helm("install", RELEASE, CHART, *FIELDS)
    (tmp_path / "token").write_text(plane.kubectl("create", "token", f"{RELEASE}-test", *FIELDS).strip())
    shutil.copy(plane.ca, tmp_path / "ca.crt")
    host, port = plane.url.removeprefix("https://").split(":")
    cluster = {"KUBERNETES_SERVICE_HOST": host, "KUBERNETES_SERVICE_PORT": port, "ACCOUNT": str(tmp_path)}
    storage = {"STORAGE": (tmp_path / "storage").as_uri(), "TIMEOUT_S": "0"}

    def check(operator: str) -> tuple[int, list[str]]:
        script = CHART / "files/scripts/check_installation.py"
        env = os.environ | cluster | storage | {"OPERATOR": operator, "PYTHONPATH": str(ROOT)}
        done = subprocess.run([sys.executable, script], env=env, capture_output=True, text=True, check=False)
        assert done.stderr == ""
        return done.returncode, done.stdout.splitlines()

    (tmp_path / "readyz").write_text("ok")
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(tmp_path))) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        works = check(f"http://127.0.0.1:{server.server_port}")
        server.shutdown()
    assert works == (
        0,
        [
            "ok    the operator is ready (HTTP 200)",
            "ok    the API server serves edgenodes, fleetspecs, missions",
            f"ok    storage at {storage['STORAGE']} wrote, read and deleted",
        ],
    )
    code, lines = check("http://127.0.0.1:9")
    assert (code, [line[:4] for line in lines]) == (1, ["FAIL", "ok  ", "ok  "])


class _Quiet(SimpleHTTPRequestHandler):
    """Serves files, and says nothing."""

    def log_message(self, format: str, *args: Any) -> None:
        pass


def test_the_previous_chart_is_older() -> None:
    versions = [yaml.safe_load((chart / "Chart.yaml").read_text())["version"] for chart in (PREVIOUS_CHART, CHART)]
    assert versions == sorted(versions)
    assert versions[0] != versions[1]

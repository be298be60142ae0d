"""What the operator of the chart may do on a real API server: what it needs, and nothing else."""

from __future__ import annotations

import ssl
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

from tests.chart import CHART, NAMESPACE, RELEASE, Helm
from tests.testbed.control_plane import ControlPlane, control_plane
from tests.testbed.requirements import need
from tests.testbed.waiting import wait_for

pytestmark = [pytest.mark.xdist_group("control-plane"), pytest.mark.slow]

FIELDS = ["--namespace", NAMESPACE]
Rights = dict[tuple[str, str], set[str]]

FOLLOW = {"list", "watch"}
EVERYWHERE = {("", "nodes"): FOLLOW}
IN_A_NAMESPACE = {
    ("fleetcomputer.io", "fleetspecs"): FOLLOW | {"get"},
    ("fleetcomputer.io", "fleetspecs/status"): {"patch"},
    ("fleetcomputer.io", "missions"): FOLLOW | {"get", "create", "patch", "delete"},
    ("fleetcomputer.io", "missions/status"): {"patch"},
    ("batch", "jobs"): FOLLOW | {"create", "patch", "delete"},
    ("", "configmaps"): FOLLOW | {"create", "patch", "delete"},
    ("", "services"): FOLLOW | {"create", "patch", "delete"},
    ("networking.k8s.io", "networkpolicies"): FOLLOW | {"create", "patch"},
    ("", "pods"): {"list"},
    ("", "pods/resize"): {"patch"},
    ("", "events"): {"list", "create", "patch"},
}
IN_ITS_OWN = {("coordination.k8s.io", "leases"): {"create"}}
VERBS = ("get", "list", "watch", "create", "update", "patch", "delete", "deletecollection")
SPECIAL = (
    ("bind", "rbac.authorization.k8s.io", "clusterroles"),
    ("escalate", "rbac.authorization.k8s.io", "clusterroles"),
    ("impersonate", "", "users"),
    ("impersonate", "", "serviceaccounts"),
    ("approve", "certificates.k8s.io", "signers"),
    ("sign", "certificates.k8s.io", "signers"),
)


class Reviewer:
    """Asks the API server what a service account of the release's namespace may do."""

    def __init__(self, api: httpx.Client, account: str) -> None:
        self._client = api
        self._user = {
            "user": f"system:serviceaccount:{NAMESPACE}:{account}",
            "groups": ["system:serviceaccounts", f"system:serviceaccounts:{NAMESPACE}", "system:authenticated"],
        }

    def may(self, **attributes: str) -> bool:
        """Whether it may."""
        review = {
            "apiVersion": "authorization.k8s.io/v1",
            "kind": "SubjectAccessReview",
            "spec": self._user | {"resourceAttributes": attributes},
        }
        answer = self._client.post("/apis/authorization.k8s.io/v1/subjectaccessreviews", json=review)
        return bool(answer.raise_for_status().json()["status"]["allowed"])

    def rights(self, namespace: str) -> Rights:
        """Every verb that the cluster has, on every resource and subresource, that it may in a namespace ("": all)."""
        with ThreadPoolExecutor(8) as pool:
            answers = pool.map(lambda case: self._may_in(namespace, *case), cases := self._cases())
        found: Rights = {}
        for (resource, verb), yes in zip(cases, answers, strict=True):
            if yes:
                found.setdefault(resource, set()).add(verb)
        return found

    def _may_in(self, namespace: str, resource: tuple[str, str], verb: str) -> bool:
        kind, _, part = resource[1].partition("/")
        return self.may(namespace=namespace, group=resource[0], resource=kind, subresource=part, verb=verb)

    def _cases(self) -> list[tuple[tuple[str, str], str]]:
        groups = self._client.get("/apis").json()["groups"]
        paths = {"": "/api/v1"} | {each["name"]: f"/apis/{each['preferredVersion']['groupVersion']}" for each in groups}
        return [
            ((group, resource["name"]), verb)
            for group, path in paths.items()
            for resource in self._client.get(path).json()["resources"]
            for verb in resource["verbs"]
        ]


@pytest.fixture(scope="module")
def plane(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ControlPlane]:
    """A control plane of this module's own: the chart brings what belongs to a whole cluster."""
    need("helm", "openssl", "setpriv", "etcd", "kube-apiserver", "kube-controller-manager", "kubectl")
    with control_plane(tmp_path_factory.mktemp("chart-rights")) as plane:
        for namespace in (NAMESPACE, "fields", "orchards"):
            plane.kubectl("create", "namespace", namespace)
        yield plane


@pytest.fixture(scope="module")
def api(plane: ControlPlane) -> Iterator[httpx.Client]:
    """The API server, asked by its administrator."""
    trusted = ssl.create_default_context(cafile=str(plane.ca))
    token = {"Authorization": f"Bearer {plane.token}"}
    with httpx.Client(base_url=plane.url, verify=trusted, headers=token, trust_env=False, timeout=30.0) as client:
        yield client


def install(plane: ControlPlane, api: httpx.Client, folder: Path, *values: str) -> Reviewer:
    """The release with these values and no other; the rights of its operator."""
    Helm(folder, plane.kubeconfig)("upgrade", "--install", "--reset-values", RELEASE, CHART, *FIELDS, *values)
    reviewer = Reviewer(api, f"{RELEASE}-operator")
    everywhere = not values
    wait_for(
        "its rights",
        lambda: (
            reviewer.may(namespace="fields", verb="list", group="batch", resource="jobs")
            and reviewer.may(namespace="", verb="list", group="batch", resource="jobs") is everywhere
        ),
    )
    return reviewer


def test_the_operator_may_do_what_it_needs_and_nothing_else(
    plane: ControlPlane, api: httpx.Client, tmp_path: Path
) -> None:
    reviewer = install(plane, api, tmp_path)
    everybody = Reviewer(api, "nobody").rights(NAMESPACE)  # by roles that Kubernetes brings along
    anywhere = {**everybody, **EVERYWHERE, **IN_A_NAMESPACE}
    assert reviewer.rights("") == anywhere
    assert reviewer.rights(NAMESPACE) == {**anywhere, **IN_ITS_OWN}
    assert [case for case in SPECIAL if reviewer.may(verb=case[0], group=case[1], resource=case[2])] == []
    assert everybody == Reviewer(api, f"{RELEASE}-hdfs").rights(NAMESPACE), "HDFS may nothing more"
    assert sum(len(verbs) for verbs in everybody.values()) < 10


def test_the_operator_may_touch_one_lease(plane: ControlPlane, api: httpx.Client, tmp_path: Path) -> None:
    reviewer = install(plane, api, tmp_path)
    leases = {"namespace": NAMESPACE, "group": "coordination.k8s.io", "resource": "leases"}
    found = {
        name: [verb for verb in VERBS if reviewer.may(**leases, verb=verb, name=name)]
        for name in (f"{RELEASE}-operator", "another")
    }
    assert found == {f"{RELEASE}-operator": ["get", "create", "update"], "another": ["create"]}


def test_with_named_namespaces_the_operator_may_nothing_elsewhere(
    plane: ControlPlane, api: httpx.Client, tmp_path: Path
) -> None:
    reviewer = install(plane, api, tmp_path, "--set", "operator.watchNamespaces={fields,orchards}")
    everybody = Reviewer(api, "nobody").rights(NAMESPACE)
    assert reviewer.rights("fields") == {**everybody, **EVERYWHERE, **IN_A_NAMESPACE}
    assert reviewer.rights("default") == {**everybody, **EVERYWHERE}
    assert reviewer.rights(NAMESPACE) == {**everybody, **EVERYWHERE, **IN_ITS_OWN}


def test_what_the_reviews_say_is_what_happens(plane: ControlPlane, api: httpx.Client, tmp_path: Path) -> None:
    install(plane, api, tmp_path)
    token = plane.kubectl("create", "token", f"{RELEASE}-operator", *FIELDS).strip()
    core, own = "/api/v1", f"/api/v1/namespaces/{NAMESPACE}"
    rbac, fleets = "/apis/rbac.authorization.k8s.io/v1", "/apis/fleetcomputer.io/v1alpha1/namespaces/default/fleetspecs"
    tried = [
        ("GET", "/apis/batch/v1/jobs"),
        ("GET", f"{core}/secrets"),
        ("GET", f"{core}/namespaces/default/secrets/one"),
        ("POST", f"{own}/pods"),
        ("DELETE", f"{own}/pods/{RELEASE}-namenode-0"),
        ("POST", f"{own}/pods/{RELEASE}-namenode-0/exec?command=id"),
        ("POST", f"{own}/serviceaccounts/{RELEASE}-test/token"),
        ("PATCH", f"{core}/nodes/one"),
        ("POST", f"{rbac}/clusterrolebindings"),
        ("PATCH", f"{rbac}/clusterroles/{NAMESPACE}-{RELEASE}-operator"),
        ("PATCH", f"{fleets}/one"),
        ("DELETE", f"{fleets}/one"),
    ]
    headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/merge-patch+json"}
    answers = [api.request(method, path, headers=headers, content=b"{}").status_code for method, path in tried]
    assert answers == [200] + [403] * (len(tried) - 1)

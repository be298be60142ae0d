"""The chart's admission policy on a real API server: FleetSpecs name the storage that is allowed, and no other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.api_client import ApiClient, Manifest
from tests.chart import NAMESPACE, RELEASE, ROOT, Helm
from tests.spec_documents import fleet_document
from tests.testbed.control_plane import ControlPlane, control_plane
from tests.testbed.requirements import need
from tests.testbed.waiting import wait_for

pytestmark = [pytest.mark.xdist_group("control-plane"), pytest.mark.slow]

POLICY = f"{NAMESPACE}-{RELEASE}-storage"
OWN = f"webhdfs://fleet@{RELEASE}-namenode.{NAMESPACE}.svc:9870/fleet"
ARCHIVE = "webhdfs://archive@nn1.example.org:9870,nn2.example.org:9870/fields"
HOST = "webhdfs://alice@lab.example.org:9870"
FOLDER = "file:///fleet/storage/library"
FOREIGN = "webhdfs://fleet@elsewhere.example.org:9870/fleet"
VALUES = f'admission.storage.allowed=["{ARCHIVE}/", "{HOST}", "{FOLDER}"]'
ALLOWED = (
    OWN,
    f"{OWN}/",
    f"{OWN}?replication=3",
    f"{OWN}/barn/north_2.a?replication=3",
    ARCHIVE,
    f"{ARCHIVE}/2026",
    f"{HOST}/anything/at-all",
    f"{FOLDER}/corn",
)
REFUSED = (
    FOREIGN,
    OWN.replace("fleet@", "hdfs@"),
    OWN.replace("fleet@", ""),
    f"{OWN}s",
    f"{OWN}/../other",
    f"{OWN}/.",
    f"{OWN}/.\t./other",
    f"{OWN}/%2e%2e/other",
    f"{OWN}?doas=hdfs",
    f"{OWN}?replication=3&doas=hdfs",
    f"{OWN}#a",
    OWN.replace("9870", "9871"),
    OWN.replace(":9870", ":9870,elsewhere.example.org"),
    f"{HOST}.elsewhere.example.org/fields",
    f"{HOST},elsewhere.example.org:9870/fields",
    "file:///fleet/storage",
    f"{FOLDER}/../other",
    "file:///etc/passwd",
)


class Fleets:
    """FleetSpecs of a namespace, as the API server answers about them."""

    def __init__(self, plane: ControlPlane, namespace: str) -> None:
        self._api = ApiClient(plane)
        self._path = f"/apis/fleetcomputer.io/v1alpha1/namespaces/{namespace}/fleetspecs"

    def refusal(self, **fields: Any) -> str:
        """Why a FleetSpec with these fields would not be made; "" when it would."""
        document = fleet_document(**fields) | {"metadata": {"name": "tried"}}
        code, answer = self._api.call("POST", f"{self._path}?dryRun=All", document)
        return "" if code < 300 else str(answer["message"])

    def make(self, **fields: Any) -> None:
        code, answer = self._api.call("POST", self._path, fleet_document(**fields))
        assert code == 201, answer

    def change(self, patch: Manifest) -> tuple[int, str]:
        """Status code, and the reason when it is refused."""
        code, answer = self._api.call("PATCH", f"{self._path}/crops", patch, "merge-patch+json")
        return code, str(answer.get("reason", ""))


def contexts(*addresses: str) -> list[Manifest]:
    """Contexts of a FleetSpec: some beside it, and these."""
    known: list[Manifest] = list(fleet_document()["spec"]["contexts"])
    return known + [{"name": f"more-{place}", "uri": uri} for place, uri in enumerate(addresses)]


@pytest.fixture(scope="module")
def plane(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ControlPlane]:
    """A control plane of this module's own: the policy belongs to a whole cluster."""
    need("helm", "openssl", "setpriv", "etcd", "kube-apiserver", "kube-controller-manager", "kubectl")
    with control_plane(tmp_path_factory.mktemp("chart-admission")) as plane:
        for namespace in ("fields", "orchards"):
            plane.kubectl("create", "namespace", namespace)
        plane.kubectl("apply", "--server-side", "-f", str(ROOT / "crds"))
        plane.kubectl("wait", "--for=condition=Established", "crd", "--all")
        yield plane


@pytest.fixture
def fields(plane: ControlPlane) -> Iterator[Fleets]:
    fleets = Fleets(plane, "fields")
    wait_for("the end of other policies", lambda: fleets.refusal(storage={"uri": FOREIGN}) == "")
    yield fleets
    plane.kubectl("delete", "fleetspecs", "--all", "--namespace", "fields")
    plane.kubectl("delete", "validatingadmissionpolicies,validatingadmissionpolicybindings", "--all")


def install(plane: ControlPlane, fleets: Fleets, folder: Path, *values: str) -> str:
    """The chart's policy with these values; what it says when it is in force."""
    text = Helm(folder).render("--show-only", "templates/admission.yaml", *values)
    plane.kubectl("apply", "--server-side", "-f", "-", stdin=text)
    return wait_for("the policy", lambda: fleets.refusal(storage={"uri": FOREIGN}) or None)


def test_what_is_allowed_is_taken_and_nothing_else(plane: ControlPlane, fields: Fleets, tmp_path: Path) -> None:
    install(plane, fields, tmp_path, "--set-json", VALUES)
    everywhere: dict[str, Callable[[str], dict[str, Any]]] = {
        "storage": lambda uri: {"storage": {"uri": uri}},
        "contexts": lambda uri: {"contexts": contexts("contexts/beside", uri)},
        "pretrained": lambda uri: {"sa": {"pretrained": uri}},
    }
    for place, given in everywhere.items():
        found = {address: POLICY in fields.refusal(**given(address)) for address in ALLOWED + REFUSED}
        assert found == dict.fromkeys(ALLOWED, False) | dict.fromkeys(REFUSED, True), place
    assert fields.refusal(sa={"pretrained": "models/field.npz"}, contexts=contexts("contexts/beside")) == ""

    def checked() -> Manifest | None:
        status: Manifest = plane.get("validatingadmissionpolicy", POLICY).get("status", {})
        return status if "typeChecking" in status else None

    # The API server's own check of the expressions against the definition of FleetSpecs.
    assert wait_for("the check of the types", checked)["typeChecking"] == {}


def test_by_default_it_is_the_storage_of_the_installation(plane: ControlPlane, fields: Fleets, tmp_path: Path) -> None:
    install(plane, fields, tmp_path)
    assert fields.refusal(storage={"uri": ARCHIVE}, contexts=contexts(FOREIGN)) == (
        f"fleetspecs.fleetcomputer.io \"tried\" is forbidden: ValidatingAdmissionPolicy '{POLICY}' with binding "
        f"'{POLICY}' denied request: not allowed here: {ARCHIVE}, {FOREIGN}; allowed: {OWN} and what is below. "
        "Leave spec.storage.uri out for the storage of the platform, and put contexts and models beside the "
        "FleetSpec; or ask for the address to be put into admission.storage.allowed of the Helm release"
    )
    assert fields.refusal(storage={"uri": OWN}, contexts=contexts(f"{OWN}/library/corn")) == ""
    assert fields.refusal() == ""


def test_a_fleet_that_was_there_before_goes_on(plane: ControlPlane, fields: Fleets, tmp_path: Path) -> None:
    fields.make(storage={"uri": FOREIGN}, contexts=contexts(f"{FOREIGN}/corn"))
    install(plane, fields, tmp_path)
    other = contexts(f"{FOREIGN}/corn", f"{FOREIGN}/wheat")
    assert [
        fields.change({"metadata": {"labels": {"season": "summer"}}}),
        fields.change({"spec": {"missions": {"count": 7}}}),
        fields.change({"spec": {"contexts": other}}),
        fields.change({"spec": {"contexts": contexts(f"{OWN}/corn")}}),
        fields.change({"spec": {"contexts": contexts(f"{FOREIGN}/corn")}}),
    ] == [(200, ""), (200, ""), (403, "Forbidden"), (200, ""), (403, "Forbidden")]


def test_fleets_that_this_operator_does_not_see_to_are_not_asked_about(
    plane: ControlPlane, fields: Fleets, tmp_path: Path
) -> None:
    assert POLICY in install(plane, fields, tmp_path, "--set", "operator.watchNamespaces={fields}")
    assert Fleets(plane, "orchards").refusal(storage={"uri": FOREIGN}) == ""

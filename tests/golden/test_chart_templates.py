"""The Helm chart's manifests, held against files that were read by people; --update-golden writes them anew."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

import fleet
from fleet_operator.compiler.fleet import priority_classes
from fleet_operator.config import Config, from_environment
from tests.chart import BED_VALUES, CHART, NAMESPACE, RELEASE, ROOT, Helm, Manifest, find, pods
from tests.testbed.requirements import need

Rendered = Callable[[str], list[Manifest]]
FOLDER = Path(__file__).parent / "chart"
CASES: dict[str, tuple[Path, ...]] = {
    "default": (),
    "test-bed": (BED_VALUES,),
    "existing-storage": (FOLDER / "existing-storage.values.yaml",),
    "volume": (FOLDER / "volume.values.yaml",),
    "everything-else": (FOLDER / "everything-else.values.yaml",),
}
# Equal to crds/ and to files/scripts, which other tests read.
COPIES = ("# Source: fleet-computer/templates/crds.yaml", "# Source: fleet-computer/templates/scripts.yaml")


@pytest.fixture(scope="module")
def helm(tmp_path_factory: pytest.TempPathFactory) -> Helm:
    need("helm")
    return Helm(tmp_path_factory.mktemp("helm"))


@pytest.fixture(scope="module")
def texts(helm: Helm) -> Callable[[str], str]:
    """What the chart makes of a case, as text."""
    return cache(lambda case: helm.render(*arguments(case)))


@pytest.fixture(scope="module")
def manifests(texts: Callable[[str], str]) -> Rendered:
    """What the chart makes of a case."""
    return lambda case: [each for each in yaml.safe_load_all(texts(case)) if each]


def arguments(case: str) -> list[str]:
    return [part for file in CASES[case] for part in ("--values", str(file))]


@pytest.mark.parametrize("case", CASES)
def test_manifests_are_as_they_were_read(texts: Callable[[str], str], case: str, update_golden: bool) -> None:
    file = FOLDER / f"{case}.yaml"
    documents = texts(case).removeprefix("---\n").split("\n---\n")
    text = "\n---\n".join(each for each in documents if not each.startswith(COPIES))
    if update_golden:
        file.write_text(text)
    assert text == file.read_text()


@pytest.mark.parametrize("case", CASES)
def test_lint_finds_nothing(helm: Helm, case: str) -> None:
    said = helm("lint", "--strict", CHART, *arguments(case))
    assert [line for line in said.splitlines() if line.startswith("[")] == ["[INFO] Chart.yaml: icon is recommended"]


REFUSALS = {
    "hdfs.replicaton=3": "at '/hdfs': additional properties 'replicaton' not allowed",
    "hfds.replication=3": "at '': additional properties 'hfds' not allowed",
    "operator.resources.limit.cpu=1": "at '/operator/resources': additional properties 'limit' not allowed",
    "operator.resources.limits.memory=1GB": "at '/operator/resources/limits/memory': '1GB' does not match pattern",
    "operator.replicas=two": "at '/operator/replicas': got string, want integer",
    "hdfs.datanode.tolerations[0].efect=NoSchedule": "at '/hdfs/datanode/tolerations/0': additional properties 'efect'",
    "images.pullPolicy=Sometimes": ("at '/images/pullPolicy': value must be one of 'IfNotPresent', 'Always', 'Never'"),
    "storage.kind=s3": "at '/storage/kind': value must be one of 'hdfs', 'existing', 'volume'",
    "storage.existing=hdfs://namenode/fleet": "at '/storage/existing': 'hdfs://namenode/fleet' does not match pattern",
    "storage.kind=existing": (
        "storage.kind is existing, but storage.existing is empty: set it to webhdfs://user@host:9870/folder"
    ),
    "storage.existing=webhdfs://namenode/fleet": (
        "storage.existing is given, but storage.kind is hdfs: "
        "set storage.kind to existing, or leave storage.existing empty"
    ),
    "hdfs.replication=1": "hdfs.minReplication is above hdfs.replication: no write would ever be acknowledged",
    "hdfs.user=hdfs": "hdfs.user is hdfs, who may do everything in HDFS: fleets come as another user",
    "hdfs.namenode.hostPath=/var/lib/names": (
        "hdfs.namenode.hostPath is a folder of one node: name that node with hdfs.namenode.nodeSelector"
    ),
    "hdfs.datanode.hostPath=null": "at '/hdfs/datanode': missing property 'hostPath'",
    "operator.resources=null": "at '/operator': missing property 'resources'",
    "images=null": "at '': missing property 'images'",
    "storage.kind=volume,operator.watchNamespaces={fleet-system,fields}": (
        "storage.kind is volume, whose claim is in namespace fleet-system, and pods of other namespaces cannot mount "
        "it: leave operator.watchNamespaces empty, or name fleet-system alone"
    ),
    "operator.extraEnv[0].name=FLEET_OPERATOR_LEASE": (
        "operator.extraEnv has FLEET_OPERATOR_LEASE, which is there already: the chart sets it from its own values"
    ),
    "operator.extraEnv[0].name=ONE,operator.extraEnv[1].name=ONE": "operator.extraEnv has ONE, which is there already",
    "operator.storageHosts={http://archive}": "at '/operator/storageHosts/0': 'http://archive' does not match pattern",
    "admission.storage.allowed={webhdfs://fleet@archive/fields?doas=hdfs}": (
        "at '/admission/storage/allowed/0': 'webhdfs://fleet@archive/fields?doas=hdfs' does not match pattern"
    ),
}


@pytest.mark.parametrize("values", REFUSALS)
def test_values_that_cannot_be_right_are_refused_in_words(helm: Helm, values: str) -> None:
    done = helm.attempt("template", RELEASE, CHART, "--namespace", NAMESPACE, "--set", values)
    assert done.returncode != 0
    assert REFUSALS[values] in done.stderr


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("one.two", "take a name of small letters, digits and '-' that begins with a letter"),
        ("1st", "take a name of small letters, digits and '-' that begins with a letter"),
        ("a" * 41, "is longer than 40 letters"),
    ],
)
def test_releases_are_called_what_services_can_be_called(helm: Helm, name: str, reason: str) -> None:
    assert reason in helm.attempt("template", name, CHART).stderr
    assert helm.attempt("template", "a" * 40, CHART).returncode == 0


def test_no_variable_of_the_operator_can_be_there_twice(helm: Helm, manifests: Rendered) -> None:
    own = [each["name"] for each in _environment(manifests("default"))]
    assert len(own) == len(set(own)) > 10
    taken = [name for name in own if helm.attempt(*_extra(name)).returncode == 0]
    assert taken == []


def _extra(name: str) -> list[str | Path]:
    return ["template", RELEASE, CHART, "--set", f"operator.extraEnv[0].name={name}"]


def _environment(manifests: list[Manifest]) -> list[Manifest]:
    pod = find(manifests, "Deployment", f"{RELEASE}-operator")["spec"]["template"]["spec"]
    environment: list[Manifest] = pod["containers"][0]["env"]
    return environment


def test_the_schema_describes_every_value_and_no_other() -> None:
    schema = json.loads((CHART / "values.schema.json").read_text())
    described = dict(_described(schema, ""))
    values = yaml.safe_load((CHART / "values.yaml").read_text())
    assert sorted(described) == sorted({*_paths(values, described), ".global"})
    assert [path for path, part in described.items() if len(part.get("description", "")) < 5] == []


def test_no_value_can_be_taken_away() -> None:
    """What is null is not there for templates; the schema says so before they fail, or print nothing."""
    schema = json.loads((CHART / "values.schema.json").read_text())
    values = yaml.safe_load((CHART / "values.yaml").read_text())
    described = {"": schema} | dict(_described(schema, ""))
    sections = {path: part for path, part in described.items() if "properties" in part and path != ".global"}
    assert {path: sorted(part.get("required", ())) for path, part in sections.items()} == {
        path: sorted(_at(values, path)) for path in sections
    }


def _at(values: Any, path: str) -> Any:
    for name in path.split(".")[1:]:
        values = values[name]
    return values


def test_the_schema_closes_every_object() -> None:
    schema = json.loads((CHART / "values.schema.json").read_text())
    # What Kubernetes itself checks, and maps whose keys are the user's.
    kubernetes = r"(node|pod)\w*Affinity|labelSelector|valueFrom|global"
    opened = [
        path
        for path, part in _objects(schema, "")
        if "additionalProperties" not in part and not re.search(rf"({kubernetes})$", path)
    ]
    assert opened == []


def test_priority_classes_are_those_of_the_compiler(manifests: Rendered) -> None:
    rendered = [each for each in manifests("default") if each["kind"] == "PriorityClass"]
    assert {each["metadata"]["name"]: each for each in rendered} == {
        each["metadata"]["name"]: each for each in priority_classes()
    }


def test_custom_resource_definitions_are_those_of_the_project(manifests: Rendered) -> None:
    wanted = [yaml.safe_load(path.read_text()) for path in (ROOT / "crds").glob("*.yaml")]
    rendered = [each for each in manifests("default") if each["kind"] == "CustomResourceDefinition"]
    assert {each["metadata"]["name"]: each["spec"] for each in rendered} == {
        each["metadata"]["name"]: each["spec"] for each in wanted
    }, "run `python -m fleet.spec.generate`"
    assert {str(each["metadata"]["annotations"]) for each in rendered} == {"{'helm.sh/resource-policy': 'keep'}"}


def test_the_chart_has_the_version_of_the_package() -> None:
    chart = yaml.safe_load((CHART / "Chart.yaml").read_text())
    assert (chart["version"], chart["appVersion"]) == (fleet.__version__, fleet.__version__)


@pytest.mark.parametrize("case", CASES)
def test_every_container_is_hardened_and_has_requests_and_limits(manifests: Rendered, case: str) -> None:
    for _, pod in pods(manifests(case)):
        assert pod["spec"]["securityContext"]["runAsNonRoot"] is True
        assert pod["spec"]["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
        for container in [*pod["spec"].get("initContainers", []), *pod["spec"]["containers"]]:
            own = container["securityContext"]
            assert (own["allowPrivilegeEscalation"], own["readOnlyRootFilesystem"]) == (False, True)
            rights = {"drop": ["ALL"]} | ({"add": ["CHOWN"]} if container["name"] == "owner" else {})
            assert own["capabilities"] == rights
            assert own.get("runAsNonRoot", True) or container["name"] == "owner"
            assert [sorted(container["resources"][kind]) for kind in ("requests", "limits")] == [["cpu", "memory"]] * 2


@pytest.mark.parametrize("case", CASES)
def test_only_who_talks_to_the_api_server_has_a_token_and_only_datanodes_are_on_the_nodes_network(
    manifests: Rendered, case: str
) -> None:
    found = dict(pods(manifests(case)))
    tokens = {component for component, pod in found.items() if pod["spec"]["automountServiceAccountToken"]}
    on_nodes = {component for component, pod in found.items() if pod["spec"].get("hostNetwork")}
    assert tokens == {"operator"} | ({"test"} & set(found))
    assert on_nodes == {"datanode"} & set(found)


def test_the_operator_understands_what_the_chart_tells_it(manifests: Rendered) -> None:
    def told(case: str) -> Config:
        variables = {each["name"]: each.get("value", NAMESPACE) for each in _environment(manifests(case))}
        return from_environment(variables | {"FLEET_OPERATOR_IDENTITY": "one"})

    plain = Config(namespace=NAMESPACE, lease=f"{RELEASE}-operator", identity="one")
    host = f"{RELEASE}-namenode.{NAMESPACE}.svc"
    storage = replace(plain.settings, storage_uri=f"webhdfs://fleet@{host}:9870/fleet?replication=2")
    assert told("default") == replace(plain, settings=storage)
    claim = f"{RELEASE}-storage"
    volume = replace(plain.settings, storage_uri="file:///fleet/storage", storage_claim=claim, network_policies=False)
    assert told("volume") == replace(plain, settings=volume)
    assert told("existing-storage").watch_namespaces == ("fields", "orchards")
    ports_and_hosts = told("everything-else").settings
    assert ports_and_hosts.storage_ports == (9870, 19864)
    assert ports_and_hosts.storage_hosts == ("*.farm.example.org", "10.77.0.9", "archive.example.org:9870")


@pytest.mark.parametrize("case", CASES)
def test_every_selector_chooses_one_workload(manifests: Rendered, case: str) -> None:
    labels = {component: pod["metadata"].get("labels", {}) for component, pod in pods(manifests(case))}
    for manifest in manifests(case):
        spec = manifest.get("spec", {})
        match manifest["kind"]:
            case "Service":
                wanted = spec["selector"]
            case "NetworkPolicy":
                wanted = spec["podSelector"]["matchLabels"]
            case "PodDisruptionBudget" | "Deployment" | "StatefulSet" | "DaemonSet":
                wanted = spec["selector"]["matchLabels"]
            case _:
                continue
        chosen = [component for component, own in labels.items() if wanted.items() <= own.items()]
        assert chosen == [wanted["app.kubernetes.io/component"]]


def test_a_new_version_alone_restarts_no_part_of_hdfs(helm: Helm, tmp_path: Path) -> None:
    older = tmp_path / "chart"
    older.mkdir()
    for path in CHART.rglob("*"):
        target = older / path.relative_to(CHART)
        target.mkdir() if path.is_dir() else target.write_bytes(path.read_bytes())
    (older / "Chart.yaml").write_text((CHART / "Chart.yaml").read_text().replace("version: 0.1.0", "version: 0.0.9"))
    one, other = ([each for each in yaml.safe_load_all(helm.render(chart=chart)) if each] for chart in (CHART, older))
    assert _templates(one) == _templates(other)


def _templates(manifests: list[Manifest]) -> dict[str, Any]:
    kinds = [("StatefulSet", "namenode"), ("StatefulSet", "checkpoint"), ("DaemonSet", "datanode")]
    return {name: find(manifests, kind, f"{RELEASE}-{name}")["spec"]["template"] for kind, name in kinds}


def test_a_namenode_that_waits_for_a_restore_only_idles(helm: Helm) -> None:
    def container(start: str) -> Manifest:
        manifests = helm.manifests("--set", f"hdfs.namenode.start={start}")
        spec = find(manifests, "StatefulSet", f"{RELEASE}-namenode")["spec"]["template"]["spec"]
        return dict(spec["containers"][0])

    normal, wait = container("Normal"), container("Wait")
    assert (normal["args"], wait["command"], wait.get("args")) == (["namenode"], ["sleep", "infinity"], None)
    assert [name for name in wait if name.endswith("Probe")] == []


def test_notes_say_where_things_are(helm: Helm) -> None:
    said = helm("install", RELEASE, CHART, "--namespace", NAMESPACE, "--dry-run=client").partition("NOTES:\n")[2]
    for part in ("deployment/fleet-computer-operator", "webhdfs://fleet@", "kubectl label node", "helm test"):
        assert part in said
    assert max(map(len, said.splitlines())) <= 120


def _described(part: dict[str, Any], path: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Each value that the schema names, by its path."""
    for name, inner in part.get("properties", {}).items():
        yield f"{path}.{name}", inner
        if inner.get("additionalProperties") is False:
            yield from _described(inner, f"{path}.{name}")


def _paths(values: dict[str, Any], described: dict[str, Any], path: str = "") -> Iterator[str]:
    """The path of each value; not below one that the schema does not look into by name."""
    for name, value in values.items():
        here = f"{path}.{name}"
        yield here
        if isinstance(value, dict) and "properties" in described.get(here, {}):
            yield from _paths(value, described, here)


def _objects(part: Any, path: str) -> Iterator[tuple[str, dict[str, Any]]]:
    if isinstance(part, dict):
        if part.get("type") == "object":
            yield path, part
        for name, inner in part.items():
            yield from _objects(inner, f"{path}/{name}")
    elif isinstance(part, list):
        for index, inner in enumerate(part):
            yield from _objects(inner, f"{path}/{index}")

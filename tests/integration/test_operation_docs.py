"""The commands of docs/operate.md, troubleshoot.md, security.md and storage.md.

Blocks that begin with ```sh are run on a real API server with the chart and the example on it. Those that begin with
```sh pods need machines: each command's own parser reads them, and what they name is there.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from tests.chart import CHART, NAMESPACE, RELEASE, ROOT, Helm, Manifest
from tests.testbed.binaries import tool
from tests.testbed.control_plane import ControlPlane, control_plane
from tests.testbed.requirements import need
from tests.testbed.waiting import wait_for

pytestmark = [pytest.mark.xdist_group("control-plane"), pytest.mark.slow]

RUN = ("troubleshoot.md", "security.md", "operate.md")  # the last one deletes the FleetSpec
PARSED = (*RUN, "storage.md")
EXAMPLE = ROOT / "examples/crop-scouting/fleetspec.yaml"
# Each command's own parser refuses what is misspelt, and prints its help for the rest.
HELP = """
asked() { # program, then its arguments; before -- is where its options end
  local program=$1 args=() help=--help each; shift
  for each in "$@"; do
    if [ "$each" = -- ]; then args+=($help); help=; fi
    args+=("$each")
  done
  "$program" "${args[@]}" $help </dev/null >/dev/null || { echo "$program $*" >&2; exit 1; }
}
kubectl() { asked "$KUBECTL" "$@"; }
helm() { asked "$HELM" "$@"; }
fleet() { "$PYTHON" -m fleet.cli "$@" --help >/dev/null; }
"""


def blocks(names: tuple[str, ...], kind: str) -> str:
    """The commands of all blocks of a kind, in their order."""
    text = "\n".join((ROOT / "docs" / name).read_text() for name in names)
    found: list[str] = re.findall(rf"^```{kind}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    return "\n".join(found)


@pytest.fixture
def plane(tmp_path: Path) -> Iterator[ControlPlane]:
    """The chart, the example, and nodes of the names that pages have."""
    need("helm", "openssl", "setpriv", "etcd", "kube-apiserver", "kube-controller-manager", "kubectl")
    with control_plane(tmp_path / "plane") as plane:
        names = ("hub-1", "gateway-1", "gateway-2", "gateway-3")
        nodes: list[Manifest] = [{"apiVersion": "v1", "kind": "Node", "metadata": {"name": name}} for name in names]
        plane.apply(*nodes)
        helm = Helm(tmp_path, plane.kubeconfig)
        helm("install", RELEASE, CHART, "--namespace", NAMESPACE, "--create-namespace")
        plane.kubectl("create", "namespace", "fields")
        plane.kubectl("wait", "--for=condition=Established", "crd", "--all")
        plane.kubectl("apply", "-n", "fields", "-f", str(EXAMPLE))
        yield plane


def test_every_command_works(plane: ControlPlane, tmp_path: Path) -> None:
    for name in ("kubectl", "helm"):
        (tmp_path / name).symlink_to(tool(name))
    homes = {f"HELM_{kind}_HOME": str(tmp_path / kind.lower()) for kind in ("CACHE", "CONFIG", "DATA")}
    own = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "KUBECONFIG": str(plane.kubeconfig), **homes}
    done = subprocess.run(
        ["bash", "-euxo", "pipefail", "-c", blocks(RUN, "sh")],
        cwd=ROOT,
        env=os.environ | own | {"KUBECACHEDIR": str(tmp_path / "kubectl-cache")},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    assert "refused: the size of state groups cannot change" in done.stdout
    assert "no secrets" in done.stdout
    assert plane.get("fleetspecs", "-n", "fields")["items"] == [], "nothing holds a FleetSpec"
    _narrowed(plane)


def _narrowed(plane: ControlPlane) -> None:
    """The admission policy of the chart is in force, and lets the example and what docs/security.md allows through."""
    document = yaml.safe_load(EXAMPLE.read_text())
    document["spec"]["storage"] = {"uri": "webhdfs://hdfs@namenode:9870/other"}
    abroad = yaml.safe_dump(document)
    apply = ("apply", "--dry-run=server", "-n", "fields", "-f", "-")
    wait_for("the policy", lambda: "not allowed here" in plane.try_kubectl(*apply, stdin=abroad).stderr, 30.0)
    document["spec"]["storage"] = {"uri": "webhdfs://fleet@archive.example.org:9870/fields/corn"}
    wait_for("what is allowed", lambda: plane.try_kubectl(*apply, stdin=yaml.safe_dump(document)).returncode == 0, 30.0)
    plane.kubectl(*apply, stdin=EXAMPLE.read_text())


def test_commands_that_need_pods_are_well_formed(tmp_path: Path) -> None:
    need("helm", "kubectl")
    programs = {"KUBECTL": str(tool("kubectl")), "HELM": str(tool("helm")), "PYTHON": sys.executable}
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", HELP + blocks(PARSED, "sh pods")],
        cwd=ROOT,
        env=os.environ | programs | {"HOME": str(tmp_path), "KUBECONFIG": os.devnull},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]


def test_what_commands_that_need_pods_name_is_there(tmp_path: Path) -> None:
    need("helm")
    manifests = Helm(tmp_path).manifests()
    there = {f"{each['kind'].lower()}/{each['metadata']['name']}" for each in manifests}
    there |= {name.partition("/")[2] + "-0" for name in there if name.startswith("statefulset/")}
    there |= {"job/crop-scouting-train"}
    components = {each["metadata"]["labels"].get("app.kubernetes.io/component", "") for each in manifests}
    script = blocks(PARSED, "sh pods")
    named = set(re.findall(r"(?:deployment|statefulset|daemonset|job)/[a-z0-9-]+", script))
    named |= set(re.findall(r"exec (?:-i )?([a-z0-9-]+)", script))
    assert len(named) >= 4
    assert named - there == set()
    assert set(re.findall(r"component=([a-z]+)", script)) <= components
    hdfs_commands = set(re.findall(r"hdfs-node ([a-z]+)", script))
    usage = (ROOT / "containers/hdfs/hdfs-node").read_text()
    assert {word for word in hdfs_commands if not re.search(rf"^  {word}\)", usage, re.MULTILINE)} == set()
    files = {word for word in shlex.split(script, comments=True) if word.startswith(("examples/", "charts/"))}
    assert [name for name in files if not (ROOT / name).exists()] == []


def test_the_rights_of_the_security_page_are_the_chart_s(tmp_path: Path) -> None:
    need("helm")
    rules = [
        rule for each in Helm(tmp_path).manifests() if each["kind"] in ("Role", "ClusterRole") for rule in each["rules"]
    ]
    given: dict[tuple[str, str], set[str]] = {}
    for rule in rules:
        for group in rule["apiGroups"]:
            for resource in rule["resources"]:
                given.setdefault((group or "core", resource), set()).update(rule["verbs"])
    table = re.findall(
        r"^\| ([a-z0-9.]+) \| ([a-z/]+) \| ([a-z, ]+) \|$", (ROOT / "docs/security.md").read_text(), re.M
    )
    assert {(group, resource): set(verbs.split(", ")) for group, resource, verbs in table} == given

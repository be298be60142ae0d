"""docs/install.md and docs/upgrade.md work when their commands are given one after the other.

Blocks that begin with ```sh are run on a real API server. Those that begin with ```sh pods need machines: their syntax
is checked, and whether what they name is there.
"""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.chart import ROOT, Helm, Manifest
from tests.testbed.binaries import tool
from tests.testbed.control_plane import ControlPlane, control_plane
from tests.testbed.requirements import need

pytestmark = [pytest.mark.xdist_group("control-plane"), pytest.mark.slow]

UPGRADE_BEFORE = "## Uninstall"


@pytest.fixture
def plane(tmp_path: Path) -> Iterator[ControlPlane]:
    need("helm", "openssl", "setpriv", "etcd", "kube-apiserver", "kube-controller-manager", "kubectl")
    with control_plane(tmp_path / "plane") as plane:
        names = ("hub-1", "gateway-1", "gateway-2", "gateway-3")
        nodes: list[Manifest] = [{"apiVersion": "v1", "kind": "Node", "metadata": {"name": name}} for name in names]
        plane.apply(*nodes)
        yield plane


def blocks(text: str) -> list[tuple[str, str]]:
    """The kind and the commands of each block."""
    return re.findall(r"^```(sh|sh pods)\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def test_every_command_works(plane: ControlPlane, tmp_path: Path) -> None:
    install = (ROOT / "docs/install.md").read_text()
    before, uninstall = install.split(UPGRADE_BEFORE)
    upgrade = (ROOT / "docs/upgrade.md").read_text()
    script = "\n".join(commands for kind, commands in blocks(before + upgrade + uninstall) if kind == "sh")
    for name in ("kubectl", "helm"):
        (tmp_path / name).symlink_to(tool(name))
    homes = {f"HELM_{kind}_HOME": str(tmp_path / kind) for kind in ("CACHE", "CONFIG", "DATA")}
    own = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "KUBECONFIG": str(plane.kubeconfig), **homes}
    done = subprocess.run(
        ["bash", "-euxo", "pipefail", "-c", script],
        cwd=ROOT,
        env=os.environ | own | {"KUBECACHEDIR": str(tmp_path / "kubectl-cache")},
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    assert "refused: " in done.stdout
    assert "yes\nno\nnot elsewhere" in done.stdout
    assert plane.get("crd")["items"] == []


def test_commands_that_need_pods_are_well_formed_and_name_what_is_there(tmp_path: Path) -> None:
    need("helm")
    manifests = Helm(tmp_path).manifests()
    there = {f"{each['kind'].lower()}/{each['metadata']['name']}" for each in manifests}
    there |= {f"pod/{name.partition('/')[2]}-0" for name in there if name.startswith("statefulset/")}
    text = "\n".join((ROOT / "docs" / name).read_text() for name in ("install.md", "upgrade.md"))
    script = "\n".join(commands for kind, commands in blocks(text) if kind == "sh pods")
    subprocess.run(["bash", "-n", "-c", script], check=True)
    named = set(re.findall(r"(?:deployment|statefulset|daemonset)/[a-z0-9-]+", script))
    named |= {f"pod/{name}" for name in re.findall(r"exec (?:-i )?([a-z0-9-]+)", script)}
    assert len(named) >= 5
    assert named - there == set()

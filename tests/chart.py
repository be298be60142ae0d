"""The Helm chart in tests: render it, and talk to clusters with helm."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from tests.testbed.binaries import tool

Manifest = dict[str, Any]
ROOT = Path(__file__).resolve().parent.parent
CHART = ROOT / "charts/fleet-computer"
PREVIOUS_CHART = ROOT / "tests/charts/fleet-computer-0.0.1"
BED_VALUES = ROOT / "tests/testbed/values.yaml"
RELEASE, NAMESPACE = "fleet-computer", "fleet-system"
WORKLOADS = {"Deployment", "StatefulSet", "DaemonSet", "Job"}


class Helm:
    """helm with its files in a folder of its own, and a cluster when it has a kubeconfig."""

    def __init__(self, folder: Path, kubeconfig: Path | None = None) -> None:
        homes = {f"HELM_{kind}_HOME": str(folder / kind.lower()) for kind in ("CACHE", "CONFIG", "DATA")}
        cluster = {"KUBECONFIG": str(kubeconfig) if kubeconfig else os.devnull}
        self._env = os.environ | homes | cluster

    def attempt(self, *args: str | Path) -> subprocess.CompletedProcess[str]:
        """One command, with its exit code and what it prints."""
        command = [str(tool("helm")), *map(str, args)]
        return subprocess.run(command, env=self._env, text=True, capture_output=True, timeout=120, check=False)

    def __call__(self, *args: str | Path) -> str:
        """What a command prints; an AssertionError with what it said when it fails."""
        done = self.attempt(*args)
        assert done.returncode == 0, f"helm {' '.join(map(str, args))}: {done.stdout}{done.stderr}"
        return done.stdout

    def render(self, *args: str | Path, chart: Path = CHART, hooks: bool = True) -> str:
        """The chart's manifests as text."""
        return self("template", RELEASE, chart, "--namespace", NAMESPACE, *args, *([] if hooks else ["--no-hooks"]))

    def manifests(self, *args: str | Path, hooks: bool = True) -> list[Manifest]:
        """The chart's manifests."""
        return [each for each in yaml.safe_load_all(self.render(*args, hooks=hooks)) if each]


def pod_of(manifest: Manifest) -> Manifest:
    """The pod of a workload, with its metadata."""
    pod: Manifest = manifest if manifest["kind"] == "Pod" else manifest["spec"]["template"]
    return pod


def pods(manifests: list[Manifest]) -> Iterator[tuple[str, Manifest]]:
    """The component and the pod of each workload."""
    for manifest in manifests:
        if manifest["kind"] in WORKLOADS | {"Pod"}:
            yield manifest["metadata"]["labels"]["app.kubernetes.io/component"], pod_of(manifest)


def find(manifests: list[Manifest], kind: str, name: str) -> Manifest:
    """The one manifest of a kind and name."""
    (found,) = (each for each in manifests if (each["kind"], each["metadata"]["name"]) == (kind, name))
    return found

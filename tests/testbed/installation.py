"""The Fleet Computer on a cluster: its Helm chart, and its storage as this computer reaches it."""

from __future__ import annotations

import subprocess
from pathlib import Path

from fleet.storage.hdfs import HdfsStorage
from fleet.storage.open import open_storage
from tests.testbed.access import Access
from tests.testbed.binaries import tool
from tests.testbed.errors import BedError
from tests.testbed.images import image

ROOT = Path(__file__).resolve().parents[2]
CHART = ROOT / "charts/fleet-computer"
VALUES = Path(__file__).with_name("values.yaml")
RELEASE, SYSTEM = "fleet-computer", "fleet-system"


def install(cluster: Access, timeout: str = "5m") -> None:
    """helm install, or upgrade, and wait until everything is ready.

    Raises:
        BedError: it is not ready within the time; says what helm said, and how the pods are.
    """
    place = ("--kubeconfig", str(cluster.kubeconfig), "--namespace", SYSTEM, "--create-namespace")
    files = ("--values", str(VALUES), "--wait", "--timeout", timeout)
    # Images have the version as their tag: what tells that one is another is the name of its archive.
    mark = ("--set-string", f"operator.podAnnotations.image={image('operator').stem}")
    command = [str(tool("helm")), "upgrade", "--install", RELEASE, str(CHART), *place, *files, *mark]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        pods = cluster.kubectl("get", "pods", "--all-namespaces", check=False)
        raise BedError(f"helm failed: {done.stderr.strip()[-2000:]}\n{pods}")


def reach_storage(cluster: Access) -> HdfsStorage:
    """The chart's HDFS as this computer reaches it: by the NameNode's address, as it asks no DNS of the cluster."""
    service = cluster.get("service", f"{RELEASE}-namenode", "-n", SYSTEM)["spec"]
    address = service["clusterIP"]
    if address == "None":
        address = cluster.get("pod", f"{RELEASE}-namenode-0", "-n", SYSTEM)["status"]["podIP"]
    storage = open_storage(f"webhdfs://fleet@{address}:9870/fleet")
    assert isinstance(storage, HdfsStorage)
    return storage

"""The machines of the test bed: nodes, the network of pods, volumes, resize, and the power button."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from tests.testbed.bed import Bed
from tests.testbed.small_images import BUSYBOX_IMAGE
from tests.testbed.waiting import wait_for

pytestmark = [pytest.mark.machines, pytest.mark.xdist_group("bed")]
# What each pod of the network test serves at a port: the node that it is on.
SERVE = 'while :; do echo "$NODE" | nc -l -p 8080; done'
FOUND = "nslookup sensor.NAMESPACE.svc.cluster.local | sed -n 's/^Address: //p'"
ASK = f"for address in $({FOUND}); do nc $address 8080; done"


@pytest.fixture(scope="module")
def namespace(bed: Bed) -> Iterator[str]:
    name = "bed-machines"
    bed.kubectl("create", "namespace", name)
    yield name
    bed.kubectl("delete", "namespace", name, "--wait=false")


def test_every_machine_is_a_ready_node_that_says_what_it_is_for(bed: Bed) -> None:
    nodes = bed.get("nodes")["items"]
    seen = {node["metadata"]["name"]: _of_the_fleet(node["metadata"]["labels"]) for node in nodes}
    gateway = {"fleetcomputer.io/role": "gateway", "fleetcomputer.io/storage": "true"}
    assert seen == {"hub": {"fleetcomputer.io/role": "hub"}, "edge1": gateway, "edge2": gateway, "edge3": gateway}
    assert bed.readiness() == dict.fromkeys(seen, True)
    assert {node["status"]["capacity"]["memory"] for node in nodes} == {"4Gi"}
    assert len({node["status"]["nodeInfo"]["bootID"] for node in nodes}) == len(nodes)
    assert len({node["status"]["nodeInfo"]["machineID"] for node in nodes}) == len(nodes)


def test_pods_of_all_machines_find_each_other_by_the_name_of_a_headless_service(bed: Bed, namespace: str) -> None:
    bed.apply(*_sensors(namespace))
    bed.kubectl("rollout", "status", "daemonset/sensor", "--namespace", namespace, "--timeout=60s")
    pods = bed.get("pods", "--namespace", namespace, "--selector=app=sensor")["items"]
    nodes = {machine.name for machine in bed.machines}
    assert {pod["spec"]["nodeName"] for pod in pods} == nodes
    ask = ASK.replace("NAMESPACE", namespace)

    def answers(pod: str) -> set[str]:
        return set(bed.kubectl("exec", pod, "--namespace", namespace, "--", "sh", "-c", ask, check=False).split())

    for pod in pods:  # a name that was asked for before all pods had started is remembered for some seconds
        wait_for(f"all answers to {pod['spec']['nodeName']}", lambda: answers(pod["metadata"]["name"]) == nodes, 30.0)  # noqa: B023 - it is called before the next turn


def test_a_running_container_is_resized_in_place(bed: Bed, namespace: str) -> None:
    bed.apply(_pod("resized", namespace, ["sleep", "1000"]))
    bed.kubectl("wait", "pod/resized", "--for=condition=Ready", "--namespace", namespace, "--timeout=60s")
    wanted = {"cpu": "300m", "memory": "48Mi"}
    patch = {"spec": {"containers": [{"name": "main", "resources": {"requests": wanted, "limits": wanted}}]}}
    text = json.dumps(patch)
    bed.kubectl("patch", "pod", "resized", "--subresource=resize", "--namespace", namespace, "--patch", text)

    def shown() -> dict[str, Any]:
        (status,) = bed.get("pod", "resized", "--namespace", namespace)["status"]["containerStatuses"]
        return {"limits": status["resources"]["limits"], "restarts": status["restartCount"]}

    wait_for("the new limits", lambda: shown() == {"limits": wanted, "restarts": 0}, 30.0)
    group = "cat /sys/fs/cgroup/memory/memory.limit_in_bytes /sys/fs/cgroup/cpu/cpu.cfs_quota_us"
    inside = bed.kubectl("exec", "resized", "--namespace", namespace, "--", "sh", "-c", group).split()
    assert inside == [str(48 * 1024**2), "30000"]


def test_a_machine_that_goes_dark_is_noticed_and_wakes_with_its_volumes(bed: Bed, namespace: str) -> None:
    machine = bed.machine("edge3")
    write = "cat /data/lines 2>/dev/null; echo line >> /data/lines; sync; exec sleep 1000"
    mount = {"volumeMounts": [{"name": "data", "mountPath": "/data"}]}
    volume = {"name": "data", "persistentVolumeClaim": {"claimName": "kept"}}
    pod = _pod("kept", namespace, ["sh", "-c", write], mount)
    pod["spec"] |= {"volumes": [volume], "nodeSelector": {"kubernetes.io/hostname": machine.name}}
    bed.apply(_claim("kept", namespace), pod)
    bed.kubectl("wait", "pod/kept", "--for=condition=Ready", "--namespace", namespace, "--timeout=60s")
    before = _boot(bed, machine.name)

    machine.power_off()
    assert not machine.on
    try:
        wait_for("the node to be NotReady", lambda: bed.readiness()[machine.name] is False, 60.0)
    finally:
        machine.wake()
    wait_for("the node to be Ready", lambda: bed.readiness()[machine.name], 60.0)

    assert machine.on
    assert _boot(bed, machine.name) != before
    bed.kubectl("wait", "pod/kept", "--for=condition=Ready", "--namespace", namespace, "--timeout=60s", check=False)
    (volume_name,) = [one["spec"]["volumeName"] for one in bed.get("pvc", "--namespace", namespace)["items"]]
    assert "line" in machine.run("cat", f"/var/lib/fleet-volumes/{volume_name}/lines")

    bed.kubectl("delete", "pod/kept", "pvc/kept", "--namespace", namespace, "--grace-period=1", "--timeout=60s")
    wait_for("the end of the volume", lambda: bed.try_kubectl("get", "pv", volume_name).returncode != 0, 30.0)
    assert volume_name not in machine.run("ls", "/var/lib/fleet-volumes")


def _of_the_fleet(labels: dict[str, str]) -> dict[str, str]:
    return {name: value for name, value in labels.items() if name.startswith("fleetcomputer.io/")}


def _boot(bed: Bed, node: str) -> str:
    boot: str = bed.get("node", node)["status"]["nodeInfo"]["bootID"]
    return boot


def _claim(name: str, namespace: str) -> dict[str, Any]:
    spec = {"accessModes": ["ReadWriteOnce"], "resources": {"requests": {"storage": "1Mi"}}}
    meta = {"name": name, "namespace": namespace}
    return {"apiVersion": "v1", "kind": "PersistentVolumeClaim", "metadata": meta, "spec": spec}


def _container(command: list[str], more: dict[str, Any]) -> dict[str, Any]:
    limits = {"cpu": "100m", "memory": "32Mi"}
    run = {"name": "main", "image": BUSYBOX_IMAGE, "imagePullPolicy": "Never", "command": command}
    return run | {"resources": {"requests": limits, "limits": limits}} | more


def _pod(name: str, namespace: str, command: list[str], more: dict[str, Any] | None = None) -> dict[str, Any]:
    spec = {"containers": [_container(command, more or {})], "terminationGracePeriodSeconds": 0}
    return {"apiVersion": "v1", "kind": "Pod", "metadata": {"name": name, "namespace": namespace}, "spec": spec}


def _sensors(namespace: str) -> list[dict[str, Any]]:
    """A pod on each machine, and a Service without an address of its own."""
    labels = {"app": "sensor"}
    node = {"name": "NODE", "valueFrom": {"fieldRef": {"fieldPath": "spec.nodeName"}}}
    pod = _pod("", namespace, ["sh", "-c", SERVE], {"env": [node]})["spec"]
    template = {"metadata": {"labels": labels}, "spec": pod}
    meta = {"name": "sensor", "namespace": namespace}
    daemons = {"selector": {"matchLabels": labels}, "template": template}
    ports = {"clusterIP": "None", "selector": labels, "ports": [{"port": 8080}]}
    return [
        {"apiVersion": "apps/v1", "kind": "DaemonSet", "metadata": meta, "spec": daemons},
        {"apiVersion": "v1", "kind": "Service", "metadata": meta, "spec": ports},
    ]

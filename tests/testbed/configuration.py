"""Files that the programs of a machine read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tests.testbed.site import BedSpec, MachineSpec

# Where machine-init puts things; the same in every machine.
CONF = Path("/run/machine/conf")
CONTAINERD = "/run/containerd/containerd.sock"
PAUSE_IMAGE = "fleet.test/pause:1"
DOMAIN = "cluster.local"
# Plug-ins that make folders on this computer or ask for modules that are not there.
UNWANTED = (
    "io.containerd.internal.v1.opt", "io.containerd.nri.v1.nri", "io.containerd.snapshotter.v1.blockfile",
    "io.containerd.snapshotter.v1.erofs", "io.containerd.differ.v1.erofs",
    "io.containerd.tracing.processor.v1.otlp", "io.containerd.internal.v1.tracing",
)  # fmt: skip


def containerd_toml(root: str = "/var/lib/containerd") -> str:
    """Configuration of containerd. Without restrict_oom_score_adj runc cannot start a pod in a container's limits."""
    disabled = ", ".join(f'"{name}"' for name in UNWANTED)
    cri = 'plugins."io.containerd.cri.v1'
    return f"""version = 3
root = "{root}"
state = "/run/containerd"
disabled_plugins = [{disabled}]
[grpc]
  address = "{CONTAINERD}"
[{cri}.images"]
  snapshotter = "overlayfs"
[{cri}.images".pinned_images]
  sandbox = "{PAUSE_IMAGE}"
[{cri}.runtime"]
  restrict_oom_score_adj = true
  disable_apparmor = true
[{cri}.runtime".cni]
  bin_dirs = ["/usr/lib/cni"]
  conf_dir = "{CONF}/cni"
[{cri}.runtime".containerd]
  default_runtime_name = "runc"
[{cri}.runtime".containerd.runtimes.runc]
  runtime_type = "io.containerd.runc.v2"
[{cri}.runtime".containerd.runtimes.runc.options]
  BinaryName = "runc"
  SystemdCgroup = false
"""


def kubelet_configuration(spec: BedSpec, machine: MachineSpec) -> dict[str, Any]:
    """Configuration of a machine's kubelet."""
    grace_s = spec.timing.grace_s
    return {
        "apiVersion": "kubelet.config.k8s.io/v1beta1",
        "kind": "KubeletConfiguration",
        "failCgroupV1": False,
        "cgroupDriver": "cgroupfs",
        "cgroupRoot": "/",
        "failSwapOn": False,
        "authentication": {"anonymous": {"enabled": True}, "webhook": {"enabled": False}},
        "authorization": {"mode": "AlwaysAllow"},
        "clusterDNS": [spec.site.hub],
        "clusterDomain": DOMAIN,
        "resolvConf": str(CONF / "resolv.conf"),
        "containerRuntimeEndpoint": f"unix://{CONTAINERD}",
        "nodeStatusUpdateFrequency": "2s",
        "nodeStatusReportFrequency": "10s",
        "nodeLeaseDurationSeconds": grace_s,  # renewed four times in it
        "evictionHard": {"memory.available": "100Mi", "nodefs.available": "200Mi", "imagefs.available": "200Mi"},
        "imageGCHighThresholdPercent": 100,  # images cannot be pulled again
        "systemReserved": {"cpu": f"{round(machine.size.reserved_cores * 1000)}m"},
        "enforceNodeAllocatable": ["pods"],
        "maxPods": machine.size.pods,
        "serializeImagePulls": False,
        "makeIPTablesUtilChains": False,
    }


def proxy_configuration(spec: BedSpec) -> dict[str, Any]:
    """Configuration of kube-proxy; the settings of connection tracking are this computer's, and stay as they are."""
    untouched = {"maxPerCore": 0, "min": 0, "tcpEstablishedTimeout": "0s", "tcpCloseWaitTimeout": "0s"}
    return {
        "apiVersion": "kubeproxy.config.k8s.io/v1alpha1",
        "kind": "KubeProxyConfiguration",
        "mode": "nftables",
        "clientConnection": {"kubeconfig": str(CONF / "kube-proxy.kubeconfig")},
        "clusterCIDR": spec.site.pods,
        "conntrack": untouched,
        "nftables": {"syncPeriod": "30s", "minSyncPeriod": "0s"},
    }


def pod_network(spec: BedSpec, index: int) -> dict[str, Any]:
    """A bridge for the pods of a machine; addresses are forgotten with the power."""
    addresses = {
        "type": "host-local",
        "dataDir": "/run/cni-addresses",
        "ranges": [[{"subnet": spec.site.pods_of(index)}]],
        "routes": [{"dst": "0.0.0.0/0"}],
    }
    bridge = {"type": "bridge", "bridge": "cni0", "isGateway": True, "ipMasq": False, "hairpinMode": True}
    ports = {"type": "portmap", "capabilities": {"portMappings": True}}
    return {"cniVersion": "1.0.0", "name": "testbed", "plugins": [bridge | {"ipam": addresses}, ports]}


def corefile(spec: BedSpec) -> str:
    """Names of Services and pods; nothing else has a name here."""
    return f""".:53 {{
  bind {spec.site.hub}
  errors
  health {spec.site.hub}:8080
  kubernetes {DOMAIN} {{
    kubeconfig {CONF}/coredns.kubeconfig testbed
  }}
  cache 5
}}
"""


def hosts(spec: BedSpec) -> str:
    """Names of the machines."""
    lines = [f"{spec.site.address(i)} {machine.name}" for i, machine in enumerate(spec.machines)]
    return "\n".join(["127.0.0.1 localhost", *lines]) + "\n"


def faces(machine: MachineSpec, machine_id: str, boot_id: str, hosts_file: str) -> dict[str, str]:
    """Files that stand in for the kernel's in a machine, by path from the root.

    The settings are those that kubelet would change for the whole computer; it finds them as it wants them.
    """
    shown = {"MemTotal", "MemFree", "MemAvailable"}
    lines = [line.split(":") for line in Path("/proc/meminfo").read_text().splitlines()]
    own = f" {machine.size.memory_bytes // 1024} kB"
    memory = [f"{name}:{own if name in shown else rest}" for name, rest in lines]
    wanted = {"vm/overcommit_memory": "1", "vm/panic_on_oom": "0", "kernel/panic": "10", "kernel/panic_on_oops": "1"}
    wanted |= {"kernel/keys/root_maxkeys": "1000000", "kernel/keys/root_maxbytes": "25000000"}
    return {f"proc/sys/{name}": f"{value}\n" for name, value in wanted.items()} | {
        "proc/meminfo": "\n".join(memory) + "\n",
        "proc/sys/kernel/random/boot_id": f"{boot_id}\n",
        "etc/machine-id": f"{machine_id}\n",
        "etc/hosts": hosts_file,
    }


def as_json(content: dict[str, Any]) -> str:
    """A configuration file in JSON, which YAML readers take."""
    return json.dumps(content, indent=1)

"""Sets up the machines of a bed: who each program is to the API server, and what runs where."""

from __future__ import annotations

import secrets
import shutil
from pathlib import Path

from tests.testbed import configuration, programs
from tests.testbed.access import write_kubeconfig
from tests.testbed.api import Api
from tests.testbed.certificates import Authority, signing_key
from tests.testbed.configuration import CONF, as_json
from tests.testbed.machine import Machine
from tests.testbed.site import BedSpec

PORT = 6443
DISK = Path("/run/machine/disk")
STORE, PEER = "http://127.0.0.1:2379", "http://127.0.0.1:2380"
# The controllers and the scheduler end when the API server is not there soon: they wait for it.
API_READY = f"until (exec 3<>/dev/tcp/127.0.0.1/{PORT}) 2>/dev/null; do sleep 0.1; done"
CONTAINERD_READY = f"until [ -S {configuration.CONTAINERD} ]; do sleep 0.05; done"


class Provision:
    """The keys of a bed's cluster, and the configuration of its machines."""

    def __init__(self, spec: BedSpec, folder: Path) -> None:
        self._spec = spec
        self._url = f"https://{spec.site.hub}:{PORT}"
        self._pki = folder / "pki"
        self._authority = Authority(self._pki)
        self._rows: list[str] = []
        self.kubeconfig = folder / "admin.kubeconfig"
        admin = self._token("admin", "system:masters")
        self.api = Api(self._url, self._authority.certificate, admin)
        write_kubeconfig(self.kubeconfig, self._url, self._authority.certificate, {"token": admin})

    def set_up(self, machines: list[Machine]) -> None:
        """Write everything that the machines read; the first is the hub."""
        for index, machine in enumerate(machines):
            self._node(index, machine)
        self._hub(machines[0])

    def _token(self, user: str, group: str = "") -> str:
        token = secrets.token_hex(16)
        self._rows.append(f'{token},{user},{user},"{group}"')
        return token

    def _identity(self, machine: Machine, program: str, user: str, group: str = "") -> Path:
        """A program's kubeconfig in a machine."""
        name = f"{program}.kubeconfig"
        path = machine.folder / "conf" / name
        write_kubeconfig(path, self._url, CONF / "pki/ca.crt", {"token": self._token(user, group)})
        return CONF / name

    def _node(self, index: int, machine: Machine) -> None:
        spec, own = self._spec, machine.spec
        machine.write(
            {
                "containerd.toml": configuration.containerd_toml(),
                "kubelet.json": as_json(configuration.kubelet_configuration(spec, own)),
                "kube-proxy.json": as_json(configuration.proxy_configuration(spec)),
                "cni/10-testbed.conflist": as_json(configuration.pod_network(spec, index)),
                "resolv.conf": f"nameserver {spec.site.hub}\n",
                "pki/ca.crt": self._authority.certificate.read_text(),
            }
        )
        kubeconfig = self._identity(machine, "kubelet", f"system:node:{own.name}", "system:nodes")
        self._identity(machine, "kube-proxy", "system:kube-proxy")
        labels = ",".join(f"{name}={value}" for name, value in own.labels.items())
        kubelet = ["kubelet", f"--config={CONF}/kubelet.json", f"--kubeconfig={kubeconfig}"]
        kubelet += [f"--hostname-override={own.name}", f"--node-ip={spec.site.address(index)}"]
        kubelet += [f"--node-labels={labels}", "--root-dir=/var/lib/kubelet", "--cert-dir=/var/lib/kubelet/pki"]
        machine.set_program("containerd", ["containerd", "-c", f"{CONF}/containerd.toml"])
        machine.set_program("kubelet", kubelet, before=CONTAINERD_READY)
        proxy = ["kube-proxy", f"--config={CONF}/kube-proxy.json", f"--hostname-override={own.name}"]
        machine.set_program("kube-proxy", proxy)

    def _hub(self, machine: Machine) -> None:
        site, timing = self._spec.site, self._spec.timing
        keys = self._keys(machine)
        machine.set_program("etcd", programs.etcd(DISK / "etcd", STORE, PEER))
        api_server = programs.api_server(STORE, site.services, keys, Path("/run/kube-apiserver"))
        api_server += [f"--secure-port={PORT}", f"--advertise-address={site.hub}"]
        api_server += ["--kubelet-preferred-address-types=InternalIP", "--enable-admission-plugins=NodeRestriction"]
        api_server += [
            f"--default-{state}-toleration-seconds={timing.toleration_s}" for state in ("not-ready", "unreachable")
        ]
        machine.set_program("kube-apiserver", api_server)
        user = self._identity(machine, "kube-controller-manager", "system:kube-controller-manager")
        controllers = programs.controller_manager(user, keys, Path("/run/kube-controller-manager"))
        controllers += [f"--node-monitor-grace-period={timing.grace_s}s", "--node-monitor-period=1s"]
        machine.set_program("kube-controller-manager", controllers, before=API_READY)
        user = self._identity(machine, "kube-scheduler", "system:kube-scheduler")
        scheduler = programs.scheduler(user, Path("/run/kube-scheduler"))
        machine.set_program("kube-scheduler", scheduler, before=API_READY)
        # It reads every Service and pod, as its usual role of a Helm chart lets it.
        self._identity(machine, "coredns", "system:coredns", "system:masters")
        machine.write({"Corefile": configuration.corefile(self._spec)})
        machine.set_program("coredns", ["coredns", "-conf", f"{CONF}/Corefile"], before=API_READY)
        machine.write({"pki/tokens.csv": "\n".join(self._rows) + "\n"})

    def _keys(self, hub: Machine) -> programs.Keys:
        site = self._spec.site
        names = ["kubernetes.default.svc.cluster.local", "localhost", self._spec.machines[0].name]
        names += ["kubernetes", "kubernetes.default", "kubernetes.default.svc"]
        addresses = [site.hub, site.api_service, "127.0.0.1"]
        server, server_key = self._authority.sign_server("api-server", addresses, names)
        accounts_key, accounts = signing_key(self._pki, "accounts")
        inside = hub.folder / "conf/pki"
        for path in (server, server_key, accounts, accounts_key):
            shutil.copy2(path, inside / path.name)
        seen = CONF / "pki"
        return programs.Keys(
            authority=seen / "ca.crt",
            server=seen / server.name,
            server_key=seen / server_key.name,
            accounts=seen / accounts.name,
            accounts_key=seen / accounts_key.name,
            tokens=seen / "tokens.csv",
        )

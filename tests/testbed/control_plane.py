"""A Kubernetes control plane on the loopback address: etcd, API server, controllers; no machines, so no pod runs."""

from __future__ import annotations

import json
import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from tests.testbed import programs
from tests.testbed.access import Access, write_kubeconfig
from tests.testbed.api import Api
from tests.testbed.audit import AUDIT_POLICY, Request, read_audit_log
from tests.testbed.binaries import tool
from tests.testbed.certificates import Authority, signing_key
from tests.testbed.ports import Ports
from tests.testbed.processes import Program
from tests.testbed.waiting import wait_for

Flags = Mapping[str, Sequence[str]]


class ControlPlane(Access):
    """etcd and an API server (RBAC on) with free ports, and the controllers beside them."""

    def __init__(self, folder: Path, controllers: Sequence[str], *, audit: bool, flags: Flags) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        super().__init__(folder / "admin.kubeconfig")
        self.folder = folder
        self.token = secrets.token_hex(16)
        self._flags = flags
        self._audit_log = folder / "audit.log" if audit else None
        self._ports = Ports()
        self._api_port, self._etcd_port, self._etcd_peer_port = (self._ports.take() for _ in range(3))
        self.url = f"https://127.0.0.1:{self._api_port}"
        self._authority = Authority(folder / "pki")
        self.ca = self._authority.certificate
        self._tokens = {name: secrets.token_hex(16) for name in controllers}
        keys = self._keys()
        self.etcd = self._etcd()
        self.api_server = self._api_server(keys)
        self.controllers = {name: self._controller(name, keys) for name in controllers}
        self._api = Api(self.url, self.ca, self.token)
        write_kubeconfig(self.kubeconfig, self.url, self.ca, {"token": self.token})

    def start(self) -> None:
        """Start everything, and wait until objects can be made.

        Raises:
            NotReady: a program ended, or was not ready in time.
        """
        self.etcd.start()
        self.start_api_server()
        for program in self.controllers.values():
            program.start()
        wait_for("the namespace default", lambda: self._api.has("/api/v1/namespaces/default"))
        if "kube-controller-manager" in self.controllers:
            account = "/api/v1/namespaces/default/serviceaccounts/default"
            wait_for("the service account of namespace default", lambda: self._api.has(account))

    def stop(self) -> None:
        """End everything; data and logs stay in the folder."""
        for program in (*self.controllers.values(), self.api_server, self.etcd):
            program.kill()
        self._ports.close()

    def start_api_server(self) -> None:
        """Start the API server, at the address that it always had, and wait until it is ready."""
        self.api_server.start()
        self.api_server.wait_ready(lambda: self._api.has("/readyz"))

    def stop_api_server(self, *, kill: bool = False) -> None:
        """Stop the API server: open watches end; `kill` as a crash would."""
        if kill:
            self.api_server.kill()
        else:
            self.api_server.stop(timeout_s=2.0)  # by itself it waits up to a minute for its watchers

    def restart_api_server(self) -> None:
        """Stop the API server and start it again."""
        self.stop_api_server()
        self.start_api_server()

    def user(self, name: str, groups: Sequence[str] = ()) -> Path:
        """The kubeconfig of a user, who may do what RBAC grants the name and the groups (a client certificate)."""
        certificate, key = self._authority.sign_client(name, groups)
        user = {"client-certificate": str(certificate), "client-key": str(key)}
        return write_kubeconfig(certificate.with_suffix(".kubeconfig"), self.url, self.ca, user)

    def service_account(self, namespace: str, name: str) -> Path:
        """The kubeconfig of a service account that exists, with a token of one hour as a pod would get it."""
        token = self.kubectl("create", "token", name, "--namespace", namespace, "--duration=1h").strip()
        path = self.folder / "pki" / f"account-{namespace}-{name}.kubeconfig"
        return write_kubeconfig(path, self.url, self.ca, {"token": token}, namespace)

    def requests(self) -> list[Request]:
        """Every request that was answered so far; only with `audit`."""
        if self._audit_log is None:
            raise ValueError("this control plane keeps no audit log: make it with audit=True")
        return read_audit_log(self._audit_log)

    def _etcd(self) -> Program:
        data = self.folder / "etcd"
        data.mkdir(mode=0o700, exist_ok=True)
        store, peer = f"http://127.0.0.1:{self._etcd_port}", f"http://127.0.0.1:{self._etcd_peer_port}"
        return self._program(programs.etcd(data, store, peer))

    def _keys(self) -> programs.Keys:
        certificate, key = self._authority.sign_server("api-server", ["127.0.0.1", "10.96.0.1"], ["localhost"])
        private, public = signing_key(self.folder / "pki", "accounts")
        tokens = self.folder / "tokens.csv"
        rows = [f'{self.token},admin,admin,"system:masters"']
        rows += [f'{token},system:{name},{name},""' for name, token in self._tokens.items()]
        tokens.write_text("\n".join(rows) + "\n")
        tokens.chmod(0o600)
        return programs.Keys(self.ca, certificate, key, public, private, tokens)

    def _api_server(self, keys: programs.Keys) -> Program:
        store, scratch = f"http://127.0.0.1:{self._etcd_port}", self.folder / "api-server"
        flags = programs.api_server(store, "10.96.0.0/16", keys, scratch)
        address = ["--bind-address=127.0.0.1", f"--secure-port={self._api_port}", "--endpoint-reconciler-type=none"]
        return self._program([*flags, *address, *self._audit()])

    def _audit(self) -> list[str]:
        if self._audit_log is None:
            return []
        policy = self.folder / "audit-policy.json"
        policy.write_text(json.dumps(AUDIT_POLICY))
        return [f"--audit-policy-file={policy}", f"--audit-log-path={self._audit_log}"]

    def _controller(self, name: str, keys: programs.Keys) -> Program:
        kubeconfig, scratch = self.folder / f"{name}.kubeconfig", self.folder / name
        write_kubeconfig(kubeconfig, self.url, self.ca, {"token": self._tokens[name]})
        if name == "kube-scheduler":
            command = programs.scheduler(kubeconfig, scratch)
        else:
            command = programs.controller_manager(kubeconfig, keys, scratch)
        return self._program([*command, f"--secure-port={self._ports.take()}"])

    def _program(self, command: list[str]) -> Program:
        name, *flags = command
        return Program([tool(name), *flags, *self._flags.get(name, ())], self.folder / f"{name}.log")


@contextmanager
def control_plane(
    folder: Path,
    controllers: bool = True,
    scheduler: bool = False,
    *,
    audit: bool = False,
    flags: Flags | None = None,
) -> Iterator[ControlPlane]:
    """A control plane of its own that runs within the context.

    Args:
        folder: Its data, keys and logs; made if missing. A folder of an earlier one goes on from its data.
        controllers: Run the controller manager (Jobs make pods, owner references collect garbage).
        scheduler: Run the scheduler (needs nodes, for instance KWOK's).
        audit: Keep an audit log, read by `ControlPlane.requests`.
        flags: More flags by program name, for instance {"kube-apiserver": ["--v=4"]}.
    Raises:
        NotReady: a program ended, or was not ready in time.
    """
    names = ["kube-controller-manager"] * controllers + ["kube-scheduler"] * scheduler
    plane = ControlPlane(folder, names, audit=audit, flags=flags or {})
    try:
        plane.start()
        yield plane
    finally:
        plane.stop()

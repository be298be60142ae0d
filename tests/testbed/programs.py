"""Command lines of the programs of a control plane and of a machine."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

# The default of 20 requests a second delays everything when a test makes many objects.
CONTROLLER = ("--kube-api-qps=500", "--kube-api-burst=1000", "--leader-elect=false", "--profiling=false")
ISSUER = "https://kubernetes.default.svc"


@dataclass(frozen=True)
class Keys:
    """Files of a control plane that several of its programs read."""

    authority: Path
    server: Path
    server_key: Path
    accounts: Path  # public key of the tokens of service accounts
    accounts_key: Path
    tokens: Path


def etcd(data: Path, client: str, peer: str) -> list[str]:
    """The store: `client` and `peer` are URLs."""
    addresses = [f"--listen-client-urls={client}", f"--advertise-client-urls={client}"]
    addresses += [f"--listen-peer-urls={peer}", f"--initial-advertise-peer-urls={peer}"]
    # No fsync: a test's data need not outlive a power cut of this computer, and disks of CI machines are slow.
    return [
        "etcd", f"--data-dir={data}", *addresses, "--name=etcd", f"--initial-cluster=etcd={peer}",
        "--unsafe-no-fsync", "--log-level=warn",
    ]  # fmt: skip


def api_server(store: str, services: str, keys: Keys, scratch: Path) -> list[str]:
    """The API server with RBAC; where it listens is added by who runs it."""
    identity = [f"--tls-cert-file={keys.server}", f"--tls-private-key-file={keys.server_key}"]
    identity += [f"--token-auth-file={keys.tokens}", f"--client-ca-file={keys.authority}"]
    accounts = [f"--service-account-issuer={ISSUER}", f"--service-account-key-file={keys.accounts}"]
    accounts += [f"--service-account-signing-key-file={keys.accounts_key}"]
    return [
        "kube-apiserver", f"--etcd-servers={store}", f"--service-cluster-ip-range={services}", *identity, *accounts,
        "--authorization-mode=Node,RBAC", "--allow-privileged=true", "--profiling=false", f"--cert-dir={scratch}",
    ]  # fmt: skip


def controller_manager(kubeconfig: Path, keys: Keys, scratch: Path) -> list[str]:
    """The controllers, each with the rights of its own role."""
    return [
        "kube-controller-manager", f"--kubeconfig={kubeconfig}", *CONTROLLER, "--bind-address=127.0.0.1",
        "--use-service-account-credentials=true", f"--root-ca-file={keys.authority}",
        f"--service-account-private-key-file={keys.accounts_key}", f"--cert-dir={scratch}",
    ]  # fmt: skip


def scheduler(kubeconfig: Path, scratch: Path) -> list[str]:
    """The scheduler."""
    flags = [f"--kubeconfig={kubeconfig}", *CONTROLLER, "--bind-address=127.0.0.1", f"--cert-dir={scratch}"]
    return ["kube-scheduler", *flags]

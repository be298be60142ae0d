"""One user's way to a cluster: a kubeconfig file, and kubectl with it."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

from tests.testbed.binaries import tool
from tests.testbed.errors import CommandFailed


class Access:
    """A kubeconfig file that kubectl and client libraries take."""

    def __init__(self, kubeconfig: Path) -> None:
        self.kubeconfig = kubeconfig

    def kubectl(self, *args: str, stdin: str | None = None, check: bool = True, timeout_s: float = 120.0) -> str:
        """What kubectl prints to standard output.

        Raises:
            CommandFailed: it failed and `check` is set.
        """
        done = self.try_kubectl(*args, stdin=stdin, timeout_s=timeout_s)
        if check and done.returncode:
            raise CommandFailed(["kubectl", *args], done.returncode, done.stdout, done.stderr)
        return done.stdout

    def try_kubectl(
        self, *args: str, stdin: str | None = None, timeout_s: float = 120.0
    ) -> subprocess.CompletedProcess[str]:
        """kubectl with its exit code and what it prints; a failure is no error."""
        command = [str(tool("kubectl")), "--kubeconfig", str(self.kubeconfig), *args]
        # Its cache of the API's kinds must not be shared by clusters that come and go on the same address.
        env = os.environ | {"KUBECACHEDIR": str(self.kubeconfig.with_suffix(".cache"))}
        return subprocess.run(
            command, input=stdin, text=True, capture_output=True, timeout=timeout_s, check=False, env=env
        )

    def get(self, *args: str) -> Any:
        """What `kubectl get ARGS -o json` prints, read."""
        return json.loads(self.kubectl("get", *args, "-o", "json"))

    def apply(self, *manifests: dict[str, Any]) -> None:
        """Server-side apply of manifests."""
        text = json.dumps({"apiVersion": "v1", "kind": "List", "items": list(manifests)})
        self.kubectl("apply", "--server-side", "-f", "-", stdin=text)


def write_kubeconfig(
    path: Path, server: str, authority: Path, user: dict[str, str], namespace: str = "default"
) -> Path:
    """A kubeconfig file; `user` is {"token": ...} or the files of a client certificate."""
    content = {
        "apiVersion": "v1",
        "kind": "Config",
        "clusters": [{"name": "testbed", "cluster": {"server": server, "certificate-authority": str(authority)}}],
        "users": [{"name": "user", "user": user}],
        "contexts": [{"name": "testbed", "context": {"cluster": "testbed", "user": "user", "namespace": namespace}}],
        "current-context": "testbed",
    }
    path.write_text(json.dumps(content, indent=1))
    path.chmod(0o600)
    return path

"""Where the API server is, and who the operator is: a kubeconfig file, or the pod's own service account."""

from __future__ import annotations

import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from kubernetes import client, config

from fleet_operator.cluster.errors import Unauthorized

NAMESPACE_FILE = Path("/var/run/secrets/kubernetes.io/serviceaccount/namespace")


class Credentials:
    """A way to one API server.

    The token of a service account changes about every hour; the `kubernetes` library reads its file once a minute.

    Args:
        environment: KUBECONFIG names the file; without it, KUBERNETES_SERVICE_HOST means that this is a pod.
    Raises:
        Unauthorized: there is no such file, or it says nothing useful.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        self._environment = environment
        self._loaded = self._load()

    def reload(self) -> None:
        """Read everything again; the API server did not like what was said."""
        self._loaded = self._load()

    @property
    def server(self) -> str:
        """Address of the API server, without a slash at the end."""
        return str(self._loaded.host).rstrip("/")

    @property
    def proxy(self) -> str | None:
        """Proxy that the kubeconfig file names; those of the environment are not for the API server."""
        return self._loaded.proxy or None

    @cached_property
    def tls(self) -> ssl.SSLContext:
        """The one TLS context; to make one takes 10 ms and 1 MB."""
        context = ssl.create_default_context(cafile=self._loaded.ssl_ca_cert or None)
        if not self._loaded.verify_ssl:
            context.check_hostname = False
            context.verify_mode = ssl.CERT_NONE
        if self._loaded.cert_file:
            context.load_cert_chain(self._loaded.cert_file, self._loaded.key_file or None)
        return context

    @property
    def token(self) -> str:
        """Bearer token as it is now; "" when a certificate says who the operator is."""
        settings: Mapping[str, Any] = self._loaded.auth_settings()
        value = str(settings.get("BearerToken", {}).get("value") or "")
        scheme, _, rest = value.partition(" ")
        return rest.strip() if scheme.lower() == "bearer" else value

    @property
    def files(self) -> Files:
        """Paths of the certificates."""
        return Files(
            authority=self._loaded.ssl_ca_cert or "",
            certificate=self._loaded.cert_file or "",
            key=self._loaded.key_file or "",
            verify=bool(self._loaded.verify_ssl),
        )

    def _load(self) -> client.Configuration:
        loaded = client.Configuration()
        loaded.proxy = None
        path = self._environment.get("KUBECONFIG", "")
        try:
            if not path and "KUBERNETES_SERVICE_HOST" in self._environment:
                config.load_incluster_config(loaded)  # type: ignore[no-untyped-call]  # the library's own lack
            else:
                config.load_kube_config(path or None, client_configuration=loaded)  # type: ignore[no-untyped-call]  # same
        except (config.ConfigException, OSError) as error:
            message = f"{error}; name a kubeconfig file with KUBECONFIG, or run in a pod with a service account"
            raise Unauthorized(message) from error
        return loaded


@dataclass(frozen=True)
class Files:
    """Paths of what proves the API server's and the operator's identity; "" where there is none."""

    authority: str
    certificate: str
    key: str
    verify: bool


def own_namespace() -> str:
    """The namespace of the pod that this is; "" outside of a cluster."""
    try:
        return NAMESPACE_FILE.read_text().strip()
    except OSError:
        return ""

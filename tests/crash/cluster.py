"""The API server as the harness sees it: plain calls, without a proxy between."""

from __future__ import annotations

import json
import ssl
from pathlib import Path
from typing import Any

import httpx

Manifest = dict[str, Any]
FLEETS = "/apis/fleetcomputer.io/v1alpha1/namespaces/{}/fleetspecs"
# Everything that an operator may leave in a namespace, and what comes of it.
KINDS = {
    "FleetSpec": FLEETS,
    "Mission": "/apis/fleetcomputer.io/v1alpha1/namespaces/{}/missions",
    "Job": "/apis/batch/v1/namespaces/{}/jobs",
    "Pod": "/api/v1/namespaces/{}/pods",
    "Service": "/api/v1/namespaces/{}/services",
    "ConfigMap": "/api/v1/namespaces/{}/configmaps",
    "NetworkPolicy": "/apis/networking.k8s.io/v1/namespaces/{}/networkpolicies",
    "ResourceQuota": "/api/v1/namespaces/{}/resourcequotas",
    "Event": "/api/v1/namespaces/{}/events",
}


class Cluster:
    """Calls as the administrator.

    Args:
        url, ca, token: Of the control plane.
    """

    def __init__(self, url: str, ca: Path, token: str) -> None:
        tls = ssl.create_default_context(cafile=str(ca))
        headers = {"Authorization": f"Bearer {token}"}
        transport = httpx.HTTPTransport(verify=tls, retries=5)
        self._client = httpx.Client(base_url=url, headers=headers, transport=transport, trust_env=False, timeout=20)

    def close(self) -> None:
        self._client.close()

    def get(self, path: str) -> Manifest | None:
        """An object; None when there is none, or the server is away."""
        try:
            answer = self._client.get(path)
        except httpx.TransportError:
            return None
        found: Manifest = answer.json()
        return found if answer.is_success else None

    def list(self, kind: str, namespace: str) -> list[Manifest]:
        """All objects of a kind in a namespace."""
        answer = self._client.get(KINDS[kind].format(namespace)).raise_for_status()
        found: list[Manifest] = answer.json()["items"]
        return found

    def apply(self, kind: str, manifest: Manifest) -> Manifest:
        """Server-side apply as a user would do it."""
        metadata = manifest["metadata"]
        path = f"{KINDS[kind].format(metadata['namespace'])}/{metadata['name']}"
        options = {"fieldManager": "tests", "force": "true"}
        headers = {"Content-Type": "application/apply-patch+yaml"}
        answer = self._client.patch(path, content=json.dumps(manifest), params=options, headers=headers)
        return _good(answer)

    def patch(self, path: str, change: Manifest) -> Manifest:
        """A merge patch."""
        headers = {"Content-Type": "application/merge-patch+json"}
        return _good(self._client.patch(path, content=json.dumps(change), headers=headers))

    def post(self, path: str, body: Manifest) -> Manifest:
        return _good(self._client.post(path, json=body))

    def delete(self, path: str) -> None:
        """Delete in the background; what is not there is fine."""
        answer = self._client.request("DELETE", path, json={"propagationPolicy": "Background"})
        if answer.status_code != 404:
            _good(answer)

    def make_namespace(self, name: str) -> None:
        self.post("/api/v1/namespaces", {"metadata": {"name": name}})


def _good(answer: httpx.Response) -> Manifest:
    """The answer's body; the server's words when it refused."""
    if not answer.is_success:
        raise AssertionError(f"{answer.request.method} {answer.request.url}: {answer.status_code} {answer.text}")
    found: Manifest = answer.json()
    return found

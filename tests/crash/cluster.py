"""The API server as the harness sees it: plain calls, without a proxy between."""

from __future__ import annotations

import json
import ssl
import time
from pathlib import Path
from typing import Any

import httpx

Manifest = dict[str, Any]
_PATIENCE_S = 60.0
_PASSING = {429, 500, 503, 504}
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
        self._client = httpx.Client(base_url=url, headers=headers, verify=tls, trust_env=False, timeout=20)

    def close(self) -> None:
        self._client.close()

    def get(self, path: str) -> Manifest | None:
        """An object; None when there is none."""
        answer = self._send("GET", path)
        return None if answer.status_code == 404 else _good(answer)

    def list(self, kind: str, namespace: str) -> list[Manifest]:
        """All objects of a kind in a namespace."""
        found: list[Manifest] = _good(self._send("GET", KINDS[kind].format(namespace)))["items"]
        return found

    def apply(self, kind: str, manifest: Manifest) -> None:
        """Server-side apply as a user would do it."""
        metadata = manifest["metadata"]
        path = f"{KINDS[kind].format(metadata['namespace'])}/{metadata['name']}?fieldManager=tests&force=true"
        _good(self._send("PATCH", path, manifest, "application/apply-patch+yaml"))

    def patch(self, path: str, change: Manifest) -> None:
        """A merge patch."""
        _good(self._send("PATCH", path, change, "application/merge-patch+json"))

    def post(self, path: str, body: Manifest) -> None:
        """Make an object."""
        _good(self._send("POST", path, body))

    def delete(self, path: str) -> None:
        """Delete in the background; what is not there is fine."""
        answer = self._send("DELETE", path, {"propagationPolicy": "Background"})
        if answer.status_code != 404:
            _good(answer)

    def make_namespace(self, name: str) -> None:
        """Make a namespace."""
        self.post("/api/v1/namespaces", {"metadata": {"name": name}})

    def _send(
        self, method: str, path: str, body: Manifest | None = None, content_type: str = "application/json"
    ) -> httpx.Response:
        """The answer; a server that starts again is waited for."""
        content = None if body is None else json.dumps(body)
        end = time.monotonic() + _PATIENCE_S
        while True:
            try:
                answer = self._client.request(method, path, content=content, headers={"Content-Type": content_type})
            except httpx.TransportError:
                if time.monotonic() > end:
                    raise
            else:
                if answer.status_code not in _PASSING or time.monotonic() > end:
                    return answer
            time.sleep(0.2)


def _good(answer: httpx.Response) -> Manifest:
    """The answer's body; the server's words when it refused."""
    if not answer.is_success:
        raise AssertionError(f"{answer.request.method} {answer.request.url}: {answer.status_code} {answer.text}")
    found: Manifest = answer.json()
    return found

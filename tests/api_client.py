"""The REST API of a test's control plane, without kubectl: milliseconds a call, and the whole answer."""

from __future__ import annotations

import json
import ssl
import urllib.error
import urllib.request
from typing import Any

from tests.testbed.control_plane import ControlPlane

Manifest = dict[str, Any]


class ApiClient:
    """Sends requests as the administrator of a control plane."""

    def __init__(self, plane: ControlPlane) -> None:
        self._plane = plane
        handler = urllib.request.HTTPSHandler(context=ssl.create_default_context(cafile=str(plane.ca)))
        self._opener = urllib.request.build_opener(urllib.request.ProxyHandler({}), handler)

    def call(self, method: str, path: str, body: Manifest | None = None, kind: str = "json") -> tuple[int, Manifest]:
        """Status code and answer.

        Args:
            kind: Of the body: `json`, `merge-patch+json`, `apply-patch+yaml`.
        """
        request = urllib.request.Request(
            self._plane.url + path,
            method=method,
            data=None if body is None else json.dumps(body).encode(),
            headers={"Authorization": f"Bearer {self._plane.token}", "Content-Type": f"application/{kind}"},
        )
        try:
            with self._opener.open(request, timeout=30) as answer:
                return answer.status, json.load(answer)
        except urllib.error.HTTPError as error:
            with error:
                return error.code, json.load(error)

"""Plain calls to an API server, without a client library."""

from __future__ import annotations

import json
import ssl
import urllib.error
import urllib.request
from http import HTTPStatus
from pathlib import Path
from typing import Any


class Api:
    """An API server and one of its users."""

    def __init__(self, url: str, authority: Path, token: str) -> None:
        self._url = url
        self._headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
        secure = urllib.request.HTTPSHandler(context=ssl.create_default_context(cafile=str(authority)))
        # A proxy that the environment names knows nothing of addresses of this computer.
        self._opener = urllib.request.build_opener(urllib.request.ProxyHandler({}), secure)

    def call(self, method: str, path: str, body: dict[str, Any] | None = None) -> tuple[int, Any]:
        """HTTP status and answer; what is no JSON is text.

        Raises:
            OSError: the server is not there.
        """
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self._url + path, data=data, headers=self._headers, method=method)
        try:
            with self._opener.open(request, timeout=5.0) as answer:
                return answer.status, _content(answer.read())
        except urllib.error.HTTPError as refused:
            with refused:
                return refused.code, _content(refused.read())

    def has(self, path: str) -> bool:
        """Whether the server is there and answers 200."""
        try:
            return self.call("GET", path)[0] == HTTPStatus.OK
        except OSError:
            return False


def _content(data: bytes) -> Any:
    try:
        return json.loads(data)
    except ValueError:
        return data.decode(errors="replace")

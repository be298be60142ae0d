"""The API server's audit log: who asked for what, and what was answered."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# The answer to each request, and the start of each watch (its answer is written when it ends); no bodies.
AUDIT_POLICY = {
    "apiVersion": "audit.k8s.io/v1",
    "kind": "Policy",
    "omitStages": ["RequestReceived"],
    "rules": [{"level": "Metadata"}],
}


@dataclass(frozen=True)
class Request:
    """One request that the API server answered."""

    user: str
    verb: str  # get, list, watch, create, update, patch, delete, deletecollection
    group: str  # API group; "" is core
    resource: str  # with its subresource: jobs, jobs/status; "" for a path such as /healthz
    namespace: str
    name: str
    code: int  # HTTP status
    path: str


def read_audit_log(path: Path) -> list[Request]:
    """The requests in the order of their answers; a watch is there once."""
    seen: dict[str, Request] = {}
    for line in path.read_text().splitlines() if path.exists() else ():
        event = json.loads(line)
        seen.setdefault(event["auditID"], _request(event))
    return list(seen.values())


def _request(event: dict[str, Any]) -> Request:
    about = event.get("objectRef", {})
    parts = [about.get("resource", ""), about.get("subresource", "")]
    return Request(
        user=event["user"]["username"],
        verb=event["verb"],
        group=about.get("apiGroup", ""),
        resource="/".join(part for part in parts if part),
        namespace=about.get("namespace", ""),
        name=about.get("name", ""),
        code=event.get("responseStatus", {}).get("code", 0),
        path=event["requestURI"],
    )

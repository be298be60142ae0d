"""What a proxy is told to do to requests, and what it writes down of them."""

from __future__ import annotations

import json
import random
import re
from dataclasses import dataclass
from enum import StrEnum

WRITES = {"POST", "PUT", "PATCH", "DELETE"}
_REDIRECTED = re.compile(r"/webhdfs/.*[?&]op=(CREATE|APPEND)\b(?!.*&_via=)", re.IGNORECASE)
_LEASES = "/apis/coordination.k8s.io/"
_REASONS = {409: "Conflict", 429: "TooManyRequests", 500: "InternalError", 503: "ServiceUnavailable", 504: "Timeout"}


def is_write(method: str, path: str) -> bool:
    """Whether a request changes something that is worth a number."""
    if method not in WRITES or path.startswith(_LEASES):
        return False
    return not (_REDIRECTED.match(path))


class Moment(StrEnum):
    """When, in a write, something happens."""

    BEFORE = "before"  # the server never hears of the write
    AFTER = "after"  # the server has done it, the client never hears the answer


@dataclass(frozen=True)
class Write:
    """One write that went through, or that came to a hook."""

    method: str
    path: str
    body: bytes
    status: int
    at_s: float


@dataclass
class Fault:
    """What goes wrong with requests.

    Args:
        method, path: Regular expressions of what is hit; the path with its query.
        times: How often.
        share: Of the matching requests, by chance.
        status: Answered in place of the server; 0 passes the request on.
        retry_after_s: Of a 429 or 503.
        delay_s: Before anything else.
        reset: The connection is reset.
        moment: AFTER has the server do it first.
    """

    method: str = ".*"
    path: str = ".*"
    times: float = float("inf")
    share: float = 1.0
    status: int = 0
    retry_after_s: int = 1
    delay_s: float = 0.0
    reset: bool = False
    moment: Moment = Moment.BEFORE
    hits: int = 0

    @property
    def answers(self) -> bool:
        """Whether the client gets something else than the server's answer."""
        return self.reset or bool(self.status)

    def body(self) -> str:
        """What is answered, in the words of an API server."""
        reason = _REASONS.get(self.status, "")
        status = {"kind": "Status", "apiVersion": "v1", "metadata": {}, "status": "Failure", "reason": reason}
        return json.dumps({**status, "message": f"a fault of the test: {reason}", "code": self.status})

    def headers(self) -> dict[str, str]:
        """Of the answer."""
        return {"Retry-After": str(self.retry_after_s)} if self.status in {429, 503} else {}

    def takes(self, method: str, path: str, chance: random.Random) -> bool:
        """Whether this request is hit; counts it."""
        matches = re.fullmatch(self.method, method) and re.search(self.path, path)
        if self.hits >= self.times or not matches or chance.random() >= self.share:
            return False
        self.hits += 1
        return True

"""From the API server's answers to typed errors."""

from __future__ import annotations

import json

from fleet_operator.cluster.errors import (
    ClusterError,
    Conflict,
    Forbidden,
    Gone,
    Invalid,
    NotFound,
    Throttled,
    Unauthorized,
    Unavailable,
)

_TYPES: dict[int, type[ClusterError]] = {
    401: Unauthorized,
    403: Forbidden,
    404: NotFound,
    409: Conflict,
    410: Gone,
    429: Throttled,
}
_PASSING = (Throttled, Unavailable)
_LONGEST_WAIT_S = 30.0


def refusal(what: str, status: int, content: bytes, retry_after: str = "") -> ClusterError:
    """The error that an answer of 400 or more means.

    Args:
        what: Verb and path.
        content: A `Status` object as a rule (Kubernetes, API conventions, "Response Status Kind").
        retry_after: The header; seconds.
    """
    message, reason, wait_s = _status(content)
    wait_s = float(retry_after) if retry_after.isdecimal() else wait_s
    kind = _TYPES.get(status) or (Unavailable if status >= 500 else Invalid)
    if kind is Invalid and reason == "Expired":
        kind = Gone
    error = kind(f"{what}: {message or f'HTTP {status}'}", reason, status)
    error.retry_after_s = min(wait_s, _LONGEST_WAIT_S)
    return error


def is_passing(error: ClusterError) -> bool:
    """Whether the same call may succeed a little later."""
    return isinstance(error, _PASSING)


def _status(content: bytes) -> tuple[str, str, float]:
    """Message, reason and retryAfterSeconds."""
    try:
        status = json.loads(content)
        wait_s = float((status.get("details") or {}).get("retryAfterSeconds", 0))
        return str(status.get("message", "")), str(status.get("reason", "")), wait_s
    except (ValueError, AttributeError):  # a proxy's page, or nothing
        return content.decode(errors="replace").strip()[:500], "", 0.0

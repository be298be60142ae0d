"""How the API server refuses.

FleetError
└── ClusterError
    ├── Conflict             409: the object was changed meanwhile, or is being deleted
    ├── NotFound             404
    ├── Forbidden            403: RBAC, a quota, a namespace that ends
    ├── Unauthorized         401: the credentials are not, or no longer, good
    ├── Invalid              400, 405, 413, 415, 422: the request or the object is at fault; trying again does not help
    ├── Gone                 410: the watch's or list's place in history is no longer kept
    ├── Throttled            429
    ├── Unavailable          5xx, time-outs, no connection
    └── NotLeading           not sent at all: another process may be the operator now
"""

from __future__ import annotations

from fleet.errors import ExitCode, FleetError


class ClusterError(FleetError):
    """The API server refused a call.

    Args:
        reason: Kubernetes' word for it, such as AlreadyExists.
        status: HTTP status; 0 when there was no answer.
    """

    def __init__(self, message: str, reason: str = "", status: int = 0) -> None:
        self.reason = reason
        self.status = status
        self.retry_after_s = 0.0
        super().__init__(message)


class Conflict(ClusterError):
    """The object was changed meanwhile, exists already, or is being deleted."""


class NotFound(ClusterError):
    """No such object, kind or subresource."""


class Forbidden(ClusterError):
    """Refused by RBAC, by a quota, or because the namespace ends."""


class Unauthorized(ClusterError):
    """The credentials are not good, or no longer."""


class Invalid(ClusterError):
    """The object or the request is at fault; the message is the server's, and names the field."""

    exit_code = ExitCode.PERMANENT


class Gone(ClusterError):
    """The place in history that was asked for is no longer kept: list again."""


class Throttled(ClusterError):
    """The API server asks for patience, and all tries are used up."""


class Unavailable(ClusterError):
    """The API server does not answer now; trying again may help."""


class NotLeading(ClusterError):
    """This process does not hold the lease, or can no longer be sure of it: it may not write."""

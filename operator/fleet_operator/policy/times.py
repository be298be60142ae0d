"""Times as Kubernetes writes them."""

from __future__ import annotations

import math
from datetime import UTC, datetime


def rfc3339(epoch_s: float) -> str:
    """A time in whole seconds, rounded up, UTC: `2026-08-01T06:00:00Z`.

    Args:
        epoch_s: Seconds since the Unix epoch.
    """
    return datetime.fromtimestamp(math.ceil(epoch_s), UTC).strftime("%Y-%m-%dT%H:%M:%SZ")

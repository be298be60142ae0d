"""CPU and memory of a container: the FleetSpec's, else the role's default, never a request above its limit."""

from __future__ import annotations

import math
from typing import Literal

from fleet.errors import Problem, SpecError
from fleet.spec.base import Amounts, Resources, quantity_value
from fleet_operator.policy.shares import Capacity, Share

_Kind = Literal["cpu", "memory"]


def settled(given: Resources, default: Resources, path: str) -> Resources:
    """Fill what is left out; a default gives way to what is given when the two do not fit.

    Args:
        path: Where `given` stands in the FleetSpec.

    Raises:
        SpecError: a given request is above the given limit.
    """
    kinds: tuple[_Kind, ...] = ("cpu", "memory")
    pairs = {kind: _pair(given, default, kind, path) for kind in kinds}
    return Resources(
        requests=Amounts(cpu=pairs["cpu"][0], memory=pairs["memory"][0]),
        limits=Amounts(cpu=pairs["cpu"][1], memory=pairs["memory"][1]),
    )


def of_share(share: Share, smallest: Resources) -> Resources:
    """A share as resources, never below what an aggregator needs to start: below that it would only die."""
    return Resources(
        requests=_at_least(share.request, smallest.requests),
        limits=_at_least(share.limit, smallest.limits),
    )


def to_manifest(resources: Resources) -> dict[str, dict[str, str]]:
    """`resources` of a container."""
    return {
        "requests": {"cpu": resources.requests.cpu or "0", "memory": resources.requests.memory or "0"},
        "limits": {"cpu": resources.limits.cpu or "0", "memory": resources.limits.memory or "0"},
    }


def whole_cores(resources: Resources) -> int:
    """Threads that are worth starting under the CPU limit: at least one."""
    return max(1, math.floor(quantity_value(resources.limits.cpu or "1")))


def cpu_text(cores: float) -> str:
    """Cores as a quantity, in thousandths, rounded down: `750m`, `2`."""
    thousandths = math.floor(round(cores * 1000, 6))
    return str(thousandths // 1000) if thousandths % 1000 == 0 else f"{thousandths}m"


def memory_text(size_bytes: int) -> str:
    """Bytes as a quantity in MiB, rounded down."""
    return f"{size_bytes // 2**20}Mi"


def _pair(given: Resources, default: Resources, kind: _Kind, path: str) -> tuple[str, str]:
    given_request, given_limit = getattr(given.requests, kind), getattr(given.limits, kind)
    request = given_request or getattr(default.requests, kind)
    limit = given_limit or getattr(default.limits, kind)
    if quantity_value(request) <= quantity_value(limit):
        return request, limit
    if given_request and given_limit:
        message = f"the request {request} is above the limit {limit}"
        raise SpecError([Problem(f"{path}.requests.{kind}", message, "lower the request or raise the limit")])
    return (request, request) if given_request else (limit, limit)


def _at_least(capacity: Capacity, smallest: Amounts) -> Amounts:
    return Amounts(
        cpu=max(cpu_text(capacity.cores), smallest.cpu or "0", key=quantity_value),
        memory=max(memory_text(int(capacity.memory_bytes)), smallest.memory or "0", key=quantity_value),
    )

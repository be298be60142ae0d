"""Which running aggregators get other limits, when others have finished and leave them more.

Only limits change: a request that grows may find no room on its node, and what the scheduler keeps free need not grow.
Source: Kubernetes, "Resize CPU and Memory Resources assigned to Containers".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fleet.spec.base import quantity_value
from fleet_operator.compiler.missions import aggregator_resources
from fleet_operator.compiler.target import AggregatorTerms, Target

Manifest = dict[str, Any]
LEAST_GROWTH = 1.1
"""A change of less than a tenth is not worth a call to the API."""


def resizes(
    target: Target, terms: Sequence[AggregatorTerms], running: Mapping[str, Mapping[str, Any]]
) -> dict[str, Manifest]:
    """New `resources` of the aggregators' containers, by subset, where they differ enough from what they have.

    Args:
        terms: What each aggregator that is not finished shall have now.
        running: `resources` of the container in the running pod of a subset.
    Returns:
        CPU and memory together: the API takes one patch for both. Limits never fall here.
    """
    found = {}
    for each in terms:
        has = running.get(each.subset, {})
        now, wanted = has.get("limits", {}), aggregator_resources(target, each)["limits"]
        new = {name: _larger(now.get(name, "0"), amount) for name, amount in wanted.items()}
        if each.subset in running and new != now:
            found[each.subset] = {"requests": dict(has.get("requests", {})), "limits": new}
    return found


def _larger(now: str, wanted: str) -> str:
    return wanted if quantity_value(wanted) >= LEAST_GROWTH * quantity_value(now) else now

"""Where the data of each subset is: bytes of its agents' logs on each machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fleet.aggregation.subsets import Subset
from fleet.errors import StorageError
from fleet.storage.port import Located
from fleet_operator.compiler.target import Placement
from fleet_operator.reconcile.decide import Decided
from fleet_operator.resources import names
from fleet_operator.resources.roles import Role
from fleet_operator.resources.views import NodeView


def placements(decided: Decided, number: int) -> dict[str, Placement]:
    """Where the data of the subsets is; empty when the storage does not know, or all aggregators are there.

    A storage that does not say it now does not keep aggregators from running: they run anywhere.
    """
    observed = decided.observed
    if not isinstance(observed.storage, Located) or observed.subsets is None:
        return {}
    fleet, terms = observed.seen.ref.name, observed.terms(number)
    if all(names.mission_job(Role.AGGREGATOR, fleet, number, each.subset) in observed.seen.jobs for each in terms):
        return {}
    by_agent: dict[str, Mapping[str, int]] = {}
    for agent in observed.agents:
        path = observed.paths.log(number, agent)
        if path in observed.records.objects:
            try:
                by_agent[agent] = _on_nodes(observed.storage.locations(path), observed.seen.nodes)
            except StorageError:
                return {}
    return {subset.key: _placement(subset, by_agent) for subset in observed.subsets}


def _placement(subset: Subset, by_agent: Mapping[str, Mapping[str, int]]) -> Placement:
    held: dict[str, int] = {}
    for agent in subset.agents:
        for node, size in by_agent.get(agent, {}).items():
            held[node] = held.get(node, 0) + size
    return Placement(held)


def _on_nodes(held: Mapping[str, int], nodes: Sequence[NodeView]) -> dict[str, int]:
    """Bytes by node, from bytes by what the storage calls its machines; others than the cluster's do not count."""
    known = {address: node.name for node in nodes for address in node.addresses}
    found: dict[str, int] = {}
    for address, size in held.items():
        if address in known and size:
            found[known[address]] = found.get(known[address], 0) + size
    return found

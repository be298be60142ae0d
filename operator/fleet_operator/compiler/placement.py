"""Where pods may run, and how soon they are given up with a machine that is gone."""

from __future__ import annotations

from typing import Any

from fleet_operator.compiler.target import Placement, Target
from fleet_operator.resources import names
from fleet_operator.resources.roles import NodeRole, Role

Manifest = dict[str, Any]
MOST_NODES = 100
"""Nodes with data that an affinity names; beyond, those with the least data are left out."""
_PREFERRED_NODES = 10
_HOSTNAME = "kubernetes.io/hostname"
_LOST = ("node.kubernetes.io/not-ready", "node.kubernetes.io/unreachable")
_HOME = {Role.SENSOR: NodeRole.GATEWAY, Role.WORKFLOW: NodeRole.GATEWAY, Role.TRAINER: NodeRole.HUB}
_HOME_WEIGHT = 50


def affinity(role: Role, placement: Placement | None) -> Manifest | None:
    """The affinity of a role's pods: home for those that have one, the data for aggregators; None when any node does.

    Source: paper, section "Priority-based Scheduling": a node is eligible that has some of the data or is in the hub.
    """
    if placement is not None and placement.nodes:
        return {"nodeAffinity": _near_data(placement)}
    if role not in _HOME:
        return None
    term = {"weight": _HOME_WEIGHT, "preference": {"matchExpressions": [_is_in(names.ROLE_LABEL, [_HOME[role]])]}}
    return {"nodeAffinity": {"preferredDuringSchedulingIgnoredDuringExecution": [term]}}


def tolerations(target: Target) -> list[Manifest]:
    """A machine that is gone is given up sooner than after Kubernetes' 300 s: an agent in the air waits for it."""
    return [
        {
            "key": key,
            "operator": "Exists",
            "effect": "NoExecute",
            "tolerationSeconds": target.settings.lost_node_s,
        }
        for key in _LOST
    ]


def _near_data(placement: Placement) -> Manifest:
    """Nodes with data or of the hub; the more data, the better.

    Weights are 1..100, in proportion to the bytes held.
    """
    held = sorted(placement.nodes.items(), key=lambda each: (-each[1], each[0]))[:MOST_NODES]
    most = max(1, held[0][1])
    nodes = sorted(node for node, _ in held)
    terms = [_is_in(_HOSTNAME, nodes), _is_in(names.ROLE_LABEL, [NodeRole.HUB])]
    return {
        "requiredDuringSchedulingIgnoredDuringExecution": {
            "nodeSelectorTerms": [{"matchExpressions": [term]} for term in terms]
        },
        "preferredDuringSchedulingIgnoredDuringExecution": [
            {
                "weight": max(1, round(100 * size / most)),
                "preference": {"matchExpressions": [_is_in(_HOSTNAME, [node])]},
            }
            for node, size in held[:_PREFERRED_NODES]
        ],
    }


def _is_in(label: str, values: list[str]) -> Manifest:
    return {"key": label, "operator": "In", "values": [str(value) for value in values]}

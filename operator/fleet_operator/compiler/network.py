"""NetworkPolicies of a fleet: whom its pods may talk to, and nobody else.

All pods of a fleet may ask for names and reach the storage; only workflows reach the fleet's own sensors; nothing
reaches the Kubernetes API. Whether they are enforced is up to the cluster's network plugin. Probes come from the node
itself, which plugins let through.
Source: Kubernetes, "Network Policies".
"""

from __future__ import annotations

import re
from typing import Any
from urllib.parse import urlsplit

from fleet_operator.compiler.jobs import fleet_metadata
from fleet_operator.compiler.target import Target
from fleet_operator.resources import names
from fleet_operator.resources.roles import Role

Manifest = dict[str, Any]
_DNS = [{"protocol": "UDP", "port": 53}, {"protocol": "TCP", "port": 53}]
_DEFAULT_PORTS = {"http": 80, "https": 443}


def network_policies(target: Target) -> list[Manifest]:
    """The policies of a fleet; none where the installation wants none."""
    if not target.settings.network_policies:
        return []
    sensor_port = [{"protocol": "TCP", "port": target.settings.ports.sensor}]
    sensors, workflows = _pods(target, Role.SENSOR), _pods(target, Role.WORKFLOW)
    return [
        _policy(target, "all", _pods(target), {"ingress": [], "egress": _common_egress(target)}),
        _policy(target, "sensor", sensors, {"ingress": [{"from": [{"podSelector": workflows}], "ports": sensor_port}]}),
        _policy(target, "workflow", workflows, {"egress": [{"to": [{"podSelector": sensors}], "ports": sensor_port}]}),
    ]


def storage_ports(target: Target) -> tuple[int, ...]:
    """TCP ports on which pods reach the storage; none when it is a folder."""
    address = urlsplit(target.storage)
    if address.scheme == "file":
        return ()
    named = {int(port) for port in re.findall(r":(\d+)(?=,|$)", address.netloc.rpartition("@")[2])}
    if not named and address.scheme in _DEFAULT_PORTS:
        named = {_DEFAULT_PORTS[address.scheme]}
    return tuple(sorted(named.union(target.settings.storage_ports)))


def _common_egress(target: Target) -> list[Manifest]:
    """Names, and the storage: its machines are hosts with addresses of the site's network, so only ports are told."""
    ports = [{"protocol": "TCP", "port": port} for port in storage_ports(target)]
    return [{"ports": list(_DNS)}, *([{"ports": ports}] if ports else [])]


def _pods(target: Target, role: Role | None = None) -> Manifest:
    labels = {names.FLEET_LABEL: names.label_value(target.spec.name)}
    return {"matchLabels": labels | ({names.ROLE_LABEL: role.value} if role else {})}


def _policy(target: Target, what: str, pods: Manifest, rules: Manifest) -> Manifest:
    return {
        "apiVersion": "networking.k8s.io/v1",
        "kind": "NetworkPolicy",
        "metadata": fleet_metadata(target, names.network_policy(target.spec.name, what)),
        "spec": {"podSelector": pods, "policyTypes": [kind.capitalize() for kind in rules], **rules},
    }

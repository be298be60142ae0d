"""Which pod goes to which node: the highest priority first, where requests fit and affinity allows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fleet.spec.base import quantity_value

Manifest = dict[str, Any]
KEPT_FOR = "stand-in/kept-for"
"""Label of a node that takes pods of one namespace only, so that its loss is no other's."""


@dataclass(frozen=True)
class Room:
    """What pods request, or what a node has."""

    cores: float = 0.0
    memory_bytes: float = 0.0
    pods: int = 0

    def __add__(self, other: Room) -> Room:
        return Room(self.cores + other.cores, self.memory_bytes + other.memory_bytes, self.pods + other.pods)

    def holds(self, other: Room) -> bool:
        return self.cores >= other.cores and self.memory_bytes >= other.memory_bytes and self.pods >= other.pods


@dataclass(frozen=True)
class Plan:
    """What is to be done now: node by uid of a pod, and why others wait."""

    bindings: Mapping[str, str]
    waiting: Mapping[str, str]


def plan(pods: Sequence[Manifest], nodes: Sequence[Manifest]) -> Plan:
    """Where the pending pods go."""
    used = {node["metadata"]["name"]: Room() for node in nodes}
    for pod in pods:
        node = pod["spec"].get("nodeName")
        if node in used and pod["status"].get("phase") not in {"Succeeded", "Failed"}:
            used[node] += requests(pod)
    bindings: dict[str, str] = {}
    waiting: dict[str, str] = {}
    for pod in sorted((each for each in pods if _is_pending(each)), key=_order):
        allowed = [node for node in nodes if _admits(node, pod)]
        free = [node for node in allowed if _room(node).holds(used[node["metadata"]["name"]] + requests(pod))]
        if free:
            best = min(free, key=lambda node: _rank(node, used))
            name = best["metadata"]["name"]
            used[name] += requests(pod)
            bindings[pod["metadata"]["uid"]] = name
        else:
            why = "Insufficient cpu or memory" if allowed else "node(s) didn't match Pod's node affinity/selector"
            waiting[pod["metadata"]["uid"]] = f"0/{len(nodes)} nodes are available: {len(nodes)} {why}."
    return Plan(bindings, waiting)


def requests(pod: Manifest) -> Room:
    """What a pod asks for."""
    containers = [*pod["spec"].get("initContainers", ()), *pod["spec"]["containers"]]
    asked = [each.get("resources", {}).get("requests", {}) for each in containers]
    cores = sum(quantity_value(each.get("cpu", "0")) for each in asked)
    return Room(cores, sum(quantity_value(each.get("memory", "0")) for each in asked), 1)


def _room(node: Manifest) -> Room:
    has = node["status"]["allocatable"]
    return Room(quantity_value(has["cpu"]), quantity_value(has["memory"]), int(has["pods"]))


def _rank(node: Manifest, used: Mapping[str, Room]) -> tuple[bool, int, str]:
    """Nodes that are kept for a namespace first, then the emptiest."""
    name = node["metadata"]["name"]
    return KEPT_FOR not in node["metadata"].get("labels", {}), used[name].pods, name


def _is_pending(pod: Manifest) -> bool:
    spec = pod["spec"]
    is_held = "deletionTimestamp" in pod["metadata"] or spec.get("schedulingGates")
    return not spec.get("nodeName") and not is_held and pod["status"].get("phase") == "Pending"


def _order(pod: Manifest) -> tuple[int, str, str]:
    return (-pod["spec"].get("priority", 0), pod["metadata"]["creationTimestamp"], pod["metadata"]["name"])


def _admits(node: Manifest, pod: Manifest) -> bool:
    labels = node["metadata"].get("labels", {})
    selector = pod["spec"].get("nodeSelector") or {}
    if labels.get(KEPT_FOR, pod["metadata"]["namespace"]) != pod["metadata"]["namespace"]:
        return False
    if node["spec"].get("unschedulable") or any(labels.get(key) != value for key, value in selector.items()):
        return False
    if any(
        taint["effect"] != "PreferNoSchedule" and not _tolerates(pod, taint) for taint in node["spec"].get("taints", ())
    ):
        return False
    required = (pod["spec"].get("affinity") or {}).get("nodeAffinity", {})
    terms = required.get("requiredDuringSchedulingIgnoredDuringExecution", {}).get("nodeSelectorTerms")
    return terms is None or any(_term(term, labels, node["metadata"]["name"]) for term in terms)


def _tolerates(pod: Manifest, taint: Manifest) -> bool:
    return any(_matches(each, taint) for each in pod["spec"].get("tolerations", ()))


def _matches(toleration: Manifest, taint: Manifest) -> bool:
    if toleration.get("effect") not in {None, taint["effect"]}:
        return False
    if toleration.get("operator") == "Exists":
        return toleration.get("key") in {None, taint["key"]}
    same_key: bool = toleration.get("key") == taint["key"]
    return same_key and toleration.get("value", "") == taint.get("value", "")


def _term(term: Manifest, labels: Mapping[str, str], name: str) -> bool:
    fields = {"metadata.name": name}
    asked: Iterable[tuple[Manifest, Mapping[str, str]]] = [
        *((each, labels) for each in term.get("matchExpressions", ())),
        *((each, fields) for each in term.get("matchFields", ())),
    ]
    return all(_expression(each, values) for each, values in asked)


def _expression(wanted: Manifest, values: Mapping[str, str]) -> bool:
    value = values.get(wanted["key"])
    match wanted["operator"]:
        case "In":
            return value in wanted["values"]
        case "NotIn":
            return value not in wanted["values"]
        case "Exists":
            return value is not None
        case "DoesNotExist":
            return value is None
        case other:
            raise NotImplementedError(f"node affinity with the operator {other}")

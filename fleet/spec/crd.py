"""Custom resource definitions of the three resources, made from the models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fleet.spec.base import GROUP, VERSION
from fleet.spec.resources import EdgeNode, FleetSpec, Mission
from fleet.spec.schema import in_order, schema_of

Resource = type[FleetSpec] | type[Mission] | type[EdgeNode]


@dataclass(frozen=True)
class Column:
    """A column of `kubectl get`; those of priority 1 show with `-o wide` only."""

    name: str
    type: str
    json_path: str
    description: str
    priority: int = 0

    @property
    def document(self) -> dict[str, Any]:
        """The column as a CRD has it."""
        column: dict[str, Any] = {"name": self.name, "type": self.type, "jsonPath": self.json_path}
        column["description"] = self.description
        return column | ({"priority": self.priority} if self.priority else {})


UNOBSERVED = {"observedGeneration": -1}
"""Status of a resource that no controller has looked at. Without it, kstatus takes a new resource for finished."""


def _status_of(condition: str) -> str:
    return f'.status.conditions[?(@.type=="{condition}")].status'


_AGE = Column("Age", "date", ".metadata.creationTimestamp", "Time since it was made.")


@dataclass(frozen=True)
class ResourceKind:
    """What Kubernetes needs to know of a resource beside its schema."""

    model: Resource
    plural: str
    short_names: tuple[str, ...]
    namespaced: bool
    columns: tuple[Column, ...]
    observed: bool = False
    """Whether a controller writes its status: until it has, the status speaks of no generation."""

    @property
    def kind(self) -> str:
        """Kind in documents."""
        return self.model.__name__

    @property
    def definition_name(self) -> str:
        """Name of the CustomResourceDefinition."""
        return f"{self.plural}.{GROUP}"


KINDS = (
    ResourceKind(
        FleetSpec, "fleetspecs", ("fleet", "fleets"), namespaced=True, observed=True,
        columns=(
            Column("Phase", "string", ".status.phase", "What the fleet is doing."),
            Column("Missions", "string", ".status.missions", "Missions that have ended, of all."),
            Column("Coverage", "string", ".status.coverage", "Share of states visited in the last mission."),
            Column("Accuracy", "string", ".status.accuracy", "Accuracy of the last mission."),
            Column("Goals", "string", ".status.goals", "Goals met in the last mission, of all."),
            Column("Ready", "string", _status_of("Ready"), "Whether it flies, or could.", priority=1),
            Column("Degraded", "string", _status_of("Degraded"), "Whether anything is wrong.", priority=1),
            Column("Next", "string", ".status.nextMission", "When the next mission starts.", priority=1),
            Column("Context", "string", ".spec.stateSpace.context", "What missions fly over.", priority=1),
            Column("Storage", "string", ".status.storageUri", "Where the data is.", priority=1),
            _AGE,
        ),
    ),
    ResourceKind(
        Mission, "missions", ("fm",), namespaced=True, observed=True,
        columns=(
            Column("Fleet", "string", ".spec.fleet", "Name of the FleetSpec."),
            Column("Number", "integer", ".spec.number", "1 for the first mission of the fleet."),
            Column("Phase", "string", ".status.phase", "How far the mission is."),
            Column("Landed", "string", ".status.landed", "Agents that have landed, of all."),
            Column("Coverage", "string", ".status.coverage", "Share of states visited."),
            Column("Accuracy", "string", ".status.accuracy", "Accuracy."),
            Column("Goals", "string", ".status.goals", "Goals met, of all."),
            Column("Context", "string", ".spec.context", "What is flown over.", priority=1),
            Column("Records", "string", ".status.recordsUri", "Where the records are.", priority=1),
            _AGE,
        ),
    ),
    ResourceKind(
        EdgeNode, "edgenodes", ("en",), namespaced=False,
        columns=(
            Column("Node", "string", ".spec.node", "Name of the Kubernetes node."),
            Column("Role", "string", ".spec.role", "Gateway of an agent, or part of the hub."),
            Column("Power", "string", ".status.power", "State of the power state machine."),
            Column("MAC", "string", ".spec.mac", "MAC address for Wake-on-LAN.", priority=1),
            _AGE,
        ),
    ),
)  # fmt: skip


def custom_resource_definition(kind: ResourceKind) -> dict[str, Any]:
    """The CustomResourceDefinition of one resource."""
    version = {
        "name": VERSION,
        "served": True,
        "storage": True,
        "subresources": {"status": {}},
        "additionalPrinterColumns": [column.document for column in kind.columns],
        "schema": {"openAPIV3Schema": _root(kind)},
    }
    names = {
        "kind": kind.kind,
        "listKind": f"{kind.kind}List",
        "plural": kind.plural,
        "singular": kind.kind.lower(),
        "shortNames": list(kind.short_names),
        "categories": ["fleet-computer"],
    }
    return {
        "apiVersion": "apiextensions.k8s.io/v1",
        "kind": "CustomResourceDefinition",
        "metadata": {"name": kind.definition_name},
        "spec": {
            "group": GROUP,
            "names": names,
            "scope": "Namespaced" if kind.namespaced else "Cluster",
            "versions": [version],
        },
    }


def _root(kind: ResourceKind) -> dict[str, Any]:
    """The schema of the whole resource: Kubernetes checks its own fields but for the length of the name."""
    schema = schema_of(kind.model)
    parts = schema["properties"]
    name = parts["metadata"]["properties"]["name"]
    limits = {rule: name[rule] for rule in ("type", "pattern", "minLength", "maxLength")}
    parts["metadata"] = {"type": "object", "properties": {"name": limits}}
    _without_defaults(parts["status"])
    if kind.observed:
        parts["status"] = in_order(parts["status"] | {"default": dict(UNOBSERVED)})
    schema["required"] = ["spec"]
    _without_own_fields(schema)
    return schema


def _without_defaults(status: dict[str, Any]) -> None:
    """A status says what was observed; a default would say what nobody has seen."""
    status.pop("default", None)
    for part in _inner(status):
        _without_defaults(part)


def _without_own_fields(schema: dict[str, Any]) -> None:
    """Kubernetes refuses fields that it does not know."""
    schema.pop("x-examples", None)
    schema.pop("x-title", None)
    for part in _inner(schema):
        _without_own_fields(part)


def _inner(schema: dict[str, Any]) -> list[dict[str, Any]]:
    alone = [schema[name] for name in ("items", "additionalProperties") if name in schema]
    return [*schema.get("properties", {}).values(), *alone]

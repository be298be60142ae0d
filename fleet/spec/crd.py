"""Custom resource definitions of the three resources, made from the models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fleet.spec.base import GROUP, VERSION
from fleet.spec.resources import EdgeNode, FleetSpec, Mission
from fleet.spec.schema import schema_of

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


_AGE = Column("Age", "date", ".metadata.creationTimestamp", "Time since it was made.")


@dataclass(frozen=True)
class ResourceKind:
    """What Kubernetes needs to know of a resource beside its schema."""

    model: Resource
    plural: str
    short_names: tuple[str, ...]
    namespaced: bool
    columns: tuple[Column, ...]

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
        FleetSpec, "fleetspecs", ("fleet", "fleets"), namespaced=True,
        columns=(
            Column("Phase", "string", ".status.phase", "What the fleet is doing."),
            Column("Missions", "integer", ".status.missionsFlown", "Missions that have ended."),
            Column("Coverage", "string", ".status.coverage", "Share of states visited in the last mission."),
            Column("Accuracy", "string", ".status.accuracy", "Accuracy of the last mission."),
            Column("Goals", "string", ".status.goalsMet", "Goals met in the last mission."),
            Column("Context", "string", ".spec.stateSpace.context", "What missions fly over.", priority=1),
            Column("Storage", "string", ".status.storageUri", "Where the data is.", priority=1),
            _AGE,
        ),
    ),
    ResourceKind(
        Mission, "missions", ("fm",), namespaced=True,
        columns=(
            Column("Fleet", "string", ".spec.fleet", "Name of the FleetSpec."),
            Column("Number", "integer", ".spec.number", "1 for the first mission of the fleet."),
            Column("Context", "string", ".spec.context", "What is flown over."),
            Column("Phase", "string", ".status.phase", "How far the mission is."),
            Column("Goals met", "boolean", ".status.goalsMet", "Whether every goal was met."),
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

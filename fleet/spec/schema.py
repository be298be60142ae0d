"""Structural schemas, as Kubernetes wants them, from the models: the base of the CRDs, the reference and the checks.

Source: Kubernetes, "Extend the Kubernetes API with CustomResourceDefinitions", specifying a structural schema.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from functools import cache
from typing import Any

from pydantic import BaseModel

from fleet.spec.cel import RULES
from fleet.spec.yaml_text import Path

_ORDER = (
    "description", "type", "format", "default", "enum", "pattern", "anyOf", "minimum", "exclusiveMinimum", "maximum",
    "exclusiveMaximum", "minLength", "maxLength", "minItems", "maxItems", "maxProperties",
    "x-kubernetes-int-or-string", "x-kubernetes-list-type", "x-kubernetes-list-map-keys", "x-kubernetes-validations",
    "required", "properties", "additionalProperties", "items",
)  # fmt: skip


@cache
def _schema_of(model: type[BaseModel]) -> dict[str, Any]:
    full = model.model_json_schema(by_alias=True)
    definitions = full.pop("$defs", {})
    return _convert(full, definitions)


def schema_of(model: type[BaseModel]) -> dict[str, Any]:
    """The structural schema of a resource or of a part of one, with nothing left to look up.

    Beside Kubernetes' own fields it has `x-examples` and, for objects, `x-title`: `crd` takes them out.
    """
    return deepcopy(_schema_of(model))


def _convert(schema: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    """One level of pydantic's JSON schema, and all below it, in Kubernetes' form."""
    schema = _dereferenced(schema, definitions)
    title = schema.pop("title", "")
    if "const" in schema:
        del schema["const"]
        schema.pop("default", None)
    if schema.pop("x-kubernetes-int-or-string", False):
        del schema["type"]
        schema |= {"anyOf": [{"type": "integer"}, {"type": "string"}], "x-kubernetes-int-or-string": True}
    for bound in ("Minimum", "Maximum"):
        if f"exclusive{bound}" in schema:
            schema[bound.lower()] = schema[f"exclusive{bound}"]
            schema[f"exclusive{bound}"] = True
    if schema.get("type") == "integer":
        schema["format"] = "int64"
    if "items" in schema:
        schema["items"] = _convert(schema["items"], definitions)
        schema.setdefault("x-kubernetes-list-type", "atomic")
    if schema.get("additionalProperties") is False or "properties" in schema:
        schema.pop("additionalProperties", None)
    elif "additionalProperties" in schema:
        schema["additionalProperties"] = _convert(schema["additionalProperties"], definitions)
    if "properties" in schema:
        schema["properties"] = {name: _convert(part, definitions) for name, part in schema["properties"].items()}
    if title in RULES and "properties" in schema:
        schema["x-kubernetes-validations"] = [rule.document for rule in RULES[title]]
    if "properties" in schema:
        schema["x-title"] = title
    if "examples" in schema:
        schema["x-examples"] = schema.pop("examples")
    _set_default(schema)
    return in_order(schema)


def in_order(schema: dict[str, Any]) -> dict[str, Any]:
    """A schema with its fields in the order in which CRDs have them."""
    return {name: schema[name] for name in sorted(schema, key=_place)}


def _place(name: str) -> int:
    return _ORDER.index(name) if name in _ORDER else len(_ORDER)


def _dereferenced(schema: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    """Puts what `$ref` names and the one type of `X | None` in place; what stands beside them wins."""
    schema = dict(schema)
    if "$ref" in schema:
        name = schema.pop("$ref").rsplit("/", 1)[1]
        schema = deepcopy(definitions[name]) | schema
    if "anyOf" in schema:
        (one,) = (choice for choice in schema.pop("anyOf") if choice != {"type": "null"})
        schema = _dereferenced(one, definitions) | schema
    return schema


def _set_default(schema: dict[str, Any]) -> None:
    """Keeps only defaults that say something: nested ones say what differs from the defaults of their fields."""
    default = schema.pop("default", None)
    if isinstance(default, dict) and "properties" in schema:
        schema["default"] = {
            name: value
            for name, value in default.items()
            if value not in (None, [], {}) and value != _filled(schema["properties"][name])
        }
    elif default not in (None, "", [], {}):
        schema["default"] = default


def _filled(schema: dict[str, Any]) -> Any:
    """The value that the defaults of a schema amount to, as the models write it."""
    if "properties" not in schema or schema.get("default") is None:
        return schema.get("default")
    return {name: schema["default"].get(name, _blank(part)) for name, part in schema["properties"].items()}


def _blank(schema: dict[str, Any]) -> Any:
    filled = _filled(schema)
    if filled is not None:
        return filled
    return {"array": [], "object": {} if "additionalProperties" in schema else None}.get(schema.get("type", ""))


def schema_at(schema: dict[str, Any], path: Path) -> dict[str, Any] | None:
    """The schema of a part of a resource; None where nothing is known of it."""
    for part in path:
        if isinstance(part, int):
            inner = schema.get("items")
        else:
            inner = schema.get("properties", {}).get(part) or schema.get("additionalProperties")
        if not isinstance(inner, dict):
            return None
        schema = inner
    return schema


def walk(schema: dict[str, Any], value: Any, path: Path = ()) -> Iterator[tuple[Path, dict[str, Any], Any]]:
    """Every value of a document that the schema knows, from the outside in, with its path and schema."""
    yield path, schema, value
    if isinstance(value, dict):
        for name, inner in value.items():
            part = schema_at(schema, (name,)) if isinstance(name, str) else None
            if part is not None:
                yield from walk(part, inner, (*path, name))
    elif isinstance(value, list) and "items" in schema:
        for index, inner in enumerate(value):
            yield from walk(schema["items"], inner, (*path, index))

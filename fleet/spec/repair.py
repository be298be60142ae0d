"""The sound part of a broken document, so that the rules between fields can be tried on it too."""

from __future__ import annotations

from collections.abc import Iterable
from copy import deepcopy
from typing import Any

from pydantic_core import ErrorDetails

from fleet.spec.schema import schema_at
from fleet.spec.yaml_text import Path


def without_nulls(value: Any) -> Any:
    """The document without fields that have no value, as the Kubernetes API server takes it."""
    if isinstance(value, dict):
        return {name: without_nulls(inner) for name, inner in value.items() if inner is not None}
    return [without_nulls(inner) for inner in value] if isinstance(value, list) else value


def empty_fields(value: Any, path: Path = ()) -> list[Path]:
    """Where fields are that have no value."""
    if isinstance(value, dict):
        here = [(*path, name) for name, inner in value.items() if inner is None]
        return here + [found for name, inner in value.items() for found in empty_fields(inner, (*path, name))]
    if isinstance(value, list):
        return [found for index, inner in enumerate(value) for found in empty_fields(inner, (*path, index))]
    return []


def repaired(document: Any, errors: Iterable[ErrorDetails], schema: dict[str, Any]) -> Any:
    """The document with each broken value taken out, or replaced by a sound one where there must be one.

    Args:
        document: As JSON has it; not changed.
        errors: What pydantic says of it.
        schema: Its structural schema.
    Returns:
        A document with fewer errors, most often none; None when there is nothing left of it.
    """
    document = deepcopy(document)
    for error in sorted(errors, key=lambda error: -len(error["loc"])):
        if not error["loc"] or not _mend(document, error["loc"], schema):
            return None
    return document


def _mend(document: Any, path: Path, schema: dict[str, Any]) -> bool:
    """Mends one value; false when the way to it is not there."""
    around: Any = document
    try:
        for part in path[:-1]:
            around = around[part]
        parent, inner = schema_at(schema, path[:-1]) or {}, schema_at(schema, path)
        required = path[-1] in parent.get("required", ())
        if isinstance(around, dict) and not (required and inner):
            around.pop(path[-1], None)
        else:
            around[path[-1]] = _sample(inner or {})
    except (KeyError, IndexError, TypeError):
        return False
    return True


def _sample(schema: dict[str, Any]) -> Any:
    """Some value that a schema allows."""
    if "default" in schema or "enum" in schema:
        return schema.get("default", schema.get("enum", [None])[0])
    match schema.get("type"):
        case "object":
            return {name: _sample(schema["properties"][name]) for name in schema.get("required", ())}
        case "array":
            return [_sample(schema["items"])] if schema.get("minItems") else []
        case "integer" | "number":
            return schema.get("minimum", 0)
        case _:
            return (schema.get("x-examples") or ["a"])[0]

"""What the Kubernetes API server does with a custom resource, as far as a schema says it: prune, default, validate.

Written from the Kubernetes documentation of structural schemas, defaulting, list types and validation rules, apart from
`fleet.spec`, so that the CRDs are tried and not the code that makes them.
"""

from __future__ import annotations

import re
import sys
from copy import deepcopy
from functools import cache
from typing import Any

import celpy
from celpy import celtypes
from celpy.evaluation import CELEvalError, CELFunction

from fleet.spec.base import quantity_value

Schema = dict[str, Any]
RESERVED = {"as", "break", "const", "continue", "else", "for", "function", "if", "import", "in", "let", "loop"}
RESERVED |= {"namespace", "null", "package", "return", "true", "false", "var", "void", "while"}
TYPES: dict[str, Any] = {
    "object": dict,
    "array": list,
    "string": str,
    "integer": int,
    "number": (int, float),
    "boolean": bool,
}


def _environment() -> celpy.Environment:
    """CEL; cel-python raises Python's recursion limit for all, which is put back."""
    limit = sys.getrecursionlimit()
    environment = celpy.Environment()
    sys.setrecursionlimit(limit)
    return environment


ENVIRONMENT = _environment()


def refusals(schema: Schema, new: dict[str, Any], old: dict[str, Any] | None = None) -> list[str]:
    """Why the server refuses a resource, or the change of `old` to it; nothing when it takes it.

    Rules are tried when every value is right by itself; the server tries some of them on broken values too.
    """
    new = admitted(schema, new)
    wrong = _violations(schema, new, "")
    return wrong or _broken_rules(schema, new, None if old is None else admitted(schema, old), "")


def admitted(schema: Schema, resource: dict[str, Any]) -> dict[str, Any]:
    """The resource as the server keeps it: without empty fields, and with defaults."""
    resource = deepcopy(resource)
    _default(schema, resource)
    return resource


def _default(schema: Schema, value: Any) -> None:
    if isinstance(value, dict):
        for name in [name for name, inner in value.items() if inner is None]:
            del value[name]
        for name, part in schema.get("properties", {}).items():
            if name not in value and "default" in part:
                value[name] = deepcopy(part["default"])
            if name in value:
                _default(part, value[name])
    elif isinstance(value, list):
        for item in value:
            _default(schema.get("items", {}), item)


def _violations(schema: Schema, value: Any, path: str) -> list[str]:
    own = _own(schema, value)
    wrong = [f"{path}: {text}" for text in own]
    if own and own[0].endswith("has the wrong type"):
        return wrong
    if isinstance(value, dict):
        parts = schema.get("properties", {})
        wrong += [f"{path}: {name} is required" for name in schema.get("required", ()) if name not in value]
        for name, inner in value.items():
            part = parts.get(name, schema.get("additionalProperties"))
            if part is None:
                wrong += [] if path == ".metadata" else [f"{path}: unknown field {name}"]
                continue
            wrong += _violations(part, inner, f"{path}.{name}")
    elif isinstance(value, list):
        for index, item in enumerate(value):
            wrong += _violations(schema["items"], item, f"{path}[{index}]")
    return wrong


def _broken_rules(schema: Schema, value: Any, old: Any, path: str) -> list[str]:
    wrong = [f"{path}: {text}" for text in _rules(schema, value, old)]
    if isinstance(value, dict):
        for name, inner in value.items():
            part = schema.get("properties", {}).get(name, schema.get("additionalProperties", {}))
            before = old.get(name) if isinstance(old, dict) else None
            wrong += _broken_rules(part, inner, before, f"{path}.{name}")
    elif isinstance(value, list):
        for index, item in enumerate(value):
            wrong += _broken_rules(schema.get("items", {}), item, None, f"{path}[{index}]")
    return wrong


def _own(schema: Schema, value: Any) -> list[str]:
    """What a value breaks by itself."""
    if schema.get("x-kubernetes-int-or-string"):
        fits = isinstance(value, str | int) and not isinstance(value, bool)
    else:
        fits = isinstance(value, TYPES[schema["type"]]) and (isinstance(value, bool) == (schema["type"] == "boolean"))
    if not fits:
        return [f"{value!r} has the wrong type"]
    if isinstance(value, str):
        return _own_text(schema, value)
    if isinstance(value, bool):
        return []
    if isinstance(value, int | float):
        return _own_number(schema, value)
    return _own_size(schema, value)


def _own_text(schema: Schema, value: str) -> list[str]:
    wrong = []
    if "enum" in schema and value not in schema["enum"]:
        wrong.append(f"{value!r} is not a choice")
    if "pattern" in schema and not re.search(schema["pattern"], value):
        wrong.append(f"{value!r} does not match {schema['pattern']}")
    if not schema.get("minLength", 0) <= len(value) <= schema.get("maxLength", len(value)):
        wrong.append(f"{value!r} is too short or too long")
    return wrong


def _own_number(schema: Schema, value: float) -> list[str]:
    low, high = schema.get("minimum", -float("inf")), schema.get("maximum", float("inf"))
    if value < low or value > high or (schema.get("exclusiveMinimum") and value == low):
        return [f"{value} is out of range"]
    return []


def _own_size(schema: Schema, value: list[Any] | dict[str, Any]) -> list[str]:
    wrong = []
    most: int = schema.get("maxItems") or schema.get("maxProperties") or len(value)
    if not schema.get("minItems", 0) <= len(value) <= most:
        wrong.append("too few or too many items")
    kind = schema.get("x-kubernetes-list-type")
    if kind == "set" and len({str(item) for item in value}) < len(value):
        wrong.append("an item is there twice")
    if kind == "map":
        (key,) = schema["x-kubernetes-list-map-keys"]
        names = [str(item.get(key)) for item in value if isinstance(item, dict)]
        if len(set(names)) < len(names):
            wrong.append(f"a {key} is there twice")
    return wrong


def _rules(schema: Schema, value: Any, old: Any) -> list[str]:
    """CEL rules that do not hold; one that cannot be evaluated does not hold either."""
    wrong = []
    for rule in schema.get("x-kubernetes-validations", ()):
        changes = "oldSelf" in rule["rule"]
        if changes and old is None:
            continue
        try:
            activation = {"self": typed(schema, value)} | ({"oldSelf": typed(schema, old)} if changes else {})
            holds = bool(program(rule["rule"]).evaluate(activation))
        except (CELEvalError, ValueError):
            holds = False
        if not holds:
            wrong.append(rule["message"])
    return wrong


def typed(schema: Schema, value: Any) -> Any:
    """A value as CEL sees it: its type is the schema's."""
    if isinstance(value, dict):
        parts = schema.get("properties", {})
        inner = schema.get("additionalProperties", {})
        return celtypes.MapType({
            celtypes.StringType(escaped(name) if name in parts else name): typed(parts.get(name, inner), item)
            for name, item in value.items()
        })  # fmt: skip
    if isinstance(value, list):
        return celtypes.ListType([typed(schema.get("items", {}), item) for item in value])
    if isinstance(value, bool):
        return celtypes.BoolType(value)
    if isinstance(value, str):
        return celtypes.StringType(value)
    if schema.get("type") == "number":
        return celtypes.DoubleType(value)
    return celtypes.IntType(value) if isinstance(value, int) else celtypes.DoubleType(value)


def escaped(name: str) -> str:
    """The name of a field in a rule."""
    return f"__{name}__" if name in RESERVED else name


@cache
def program(rule: str) -> celpy.Runner:
    """A rule, ready to be evaluated; Kubernetes' quantity library is there as far as the rules use it."""
    functions: dict[str, CELFunction] = {
        "quantity": lambda text: celtypes.DoubleType(quantity_value(str(text))),
        "isGreaterThan": lambda one, other: celtypes.BoolType(one > other),
        "isLessThan": lambda one, other: celtypes.BoolType(one < other),
    }
    return ENVIRONMENT.program(ENVIRONMENT.compile(rule), functions=functions)

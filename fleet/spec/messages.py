"""Pydantic's errors in plain words: what is wrong, and what to write instead."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Any

from pydantic_core import ErrorDetails

from fleet.spec.base import FUNCTION_PATTERN, METRIC_PATTERN, NAME_PATTERN, NODE_PATTERN
from fleet.spec.findings import Finding, did_you_mean, listed, nearest
from fleet.spec.resources import IPV4_PATTERN, MAC_PATTERN
from fleet.spec.schema import schema_at
from fleet.spec.yaml_text import Path, render

Schema = dict[str, Any]


def findings(errors: Iterable[ErrorDetails], schema: Schema) -> list[Finding]:
    """Each error once, in the words of `Finding`.

    Args:
        errors: Of one validation.
        schema: Structural schema of the resource that was validated.
    """
    told = list(errors)
    meant = {_meant(error, schema) for error in told if error["type"] == "extra_forbidden"}
    broken = [error["loc"] for error in told]
    return [
        _finding(error, schema)
        for error in told
        if not (error["type"] == "missing" and error["loc"] in meant) and not _follows_from(error, broken)
    ]


def _follows_from(error: ErrorDetails, broken: list[Path]) -> bool:
    """Pydantic calls a list too short when its only item is broken."""
    place = error["loc"]
    return error["type"] == "too_short" and any(len(loc) > len(place) and loc[: len(place)] == place for loc in broken)


def _meant(error: ErrorDetails, schema: Schema) -> Path | None:
    """The field that an unknown field was probably meant to be."""
    *parent, name = error["loc"]
    known = (schema_at(schema, tuple(parent)) or {}).get("properties", {})
    near = nearest(str(name), known)
    return (*parent, near) if near else None


def _finding(error: ErrorDetails, schema: Schema) -> Finding:
    path: Path = error["loc"]
    part = schema_at(schema, path) or {}
    value = error.get("input")
    context = error.get("ctx", {})
    match error["type"]:
        case "missing":
            found = Finding(path, "is missing", _example(path, part))
        case "extra_forbidden":
            found = _unknown(error, schema)
        case "enum" | "literal_error":
            found = _choice(path, value, part, context)
        case "string_pattern_mismatch":
            found = Finding(path, *_pattern(str(value), context["pattern"]))
        case "value_error":
            message, _, hint = str(context["error"]).partition("; ")
            found = Finding(path, message, _in_bytes(value) or hint)
        case "finite_number":
            found = Finding(path, f"must be a finite number, and is {value}", "remove the line if there is no bound")
        case kind if kind in _SIZES:
            found = Finding(path, _SIZES[kind].format(**_short(context), length=_length(value)), _size_hint(kind, part))
        case kind if kind in _TYPES:
            found = Finding(path, f"must be {_TYPES[kind]}, and is {described(value)}", _type_hint(kind, value, part))
        case _:
            found = Finding(path, f"{error['msg'][0].lower()}{error['msg'][1:]}, and it is {described(value)}")
    return found


_TYPES = {
    "string_type": "a text",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "int_parsing_size": "a whole number of at most 64 bits",
    "float_type": "a number",
    "bool_type": "true or false",
    "tuple_type": "a list",
    "dict_type": "a mapping of fields to values",
    "model_type": "a mapping of fields to values",
}
_SIZES = {
    "greater_than": "must be more than {gt}, and is {length}",
    "greater_than_equal": "must be at least {ge}, and is {length}",
    "less_than": "must be less than {lt}, and is {length}",
    "less_than_equal": "must be at most {le}, and is {length}",
    "too_short": "must have at least {min_length} item, and has {length}",
    "too_long": "must have at most {max_length} items, and has {length}",
    "string_too_short": "must not be empty",
    "string_too_long": "must have at most {max_length} characters, and has {length}",
}


def described(value: Any) -> str:
    """A value in a sentence: `the text "four"`, `the number 4`, `a list`."""
    match value:
        case None:
            return "empty"
        case bool():
            return "true" if value else "false"
        case int() | float():
            return f"the number {value}"
        case str():
            return f'the text "{value[:60]}{"..." if len(value) > 60 else ""}"'
        case list():
            return "a list"
        case _:
            return "a mapping of fields to values"


def _short(context: dict[str, Any]) -> dict[str, Any]:
    """Numbers as people write them: 1, not 1.0."""
    return {name: f"{value:g}" if isinstance(value, float) else value for name, value in context.items()}


def _in_bytes(value: Any) -> str:
    """What a size such as 256MB is called in Kubernetes."""
    size = re.fullmatch(r"([0-9.]+) *([kmgt])i?b(ytes)?", value.lower()) if isinstance(value, str) else None
    return f"write {size[1]}{size[2].upper()}i" if size else ""


def _length(value: Any) -> Any:
    return len(value) if isinstance(value, str | list | dict) else value


def _size_hint(kind: str, part: Schema) -> str:
    if kind == "too_short":
        return _sample(part)
    if kind == "string_too_short":
        return "write it, or remove the line if it is not needed"
    return ""


def _type_hint(kind: str, value: Any, part: Schema) -> str:
    match kind, value:
        case "string_type", bool():
            hint = "put it in quotes: YAML reads yes, no, on and off as true and false"
        case "string_type", int() | float() if "s|m|h" in part.get("pattern", ""):
            hint = f"write a duration with its unit: {value}s"
        case "string_type", int() | float():
            hint = f'put it in quotes: "{value}"'
        case "int_type" | "float_type", str() if re.fullmatch(r"-?[0-9]+(\.[0-9]+)?", value):
            hint = f"write it without quotes: {value}"
        case "float_type", str() if re.fullmatch(r"[0-9.]+ *%", value):
            hint = f"write it as a share: {float(value.rstrip(' %')) / 100:g}"
        case "int_type" | "float_type", str():
            hint = "write it in digits"
        case "bool_type", str() | int():
            hint = "write true or false, without quotes"
        case "tuple_type", str():
            hint = f"write it in brackets: [{value}]"
        case "tuple_type", dict():
            hint = "begin each item with `- `"
        case "model_type", str() if re.fullmatch(FUNCTION_PATTERN, value) and "function" in part["properties"]:
            hint = f"write {{function: {value}}}"
        case "model_type" | "dict_type", _:
            hint = _sample(part)
        case _:
            hint = ""
    return hint


def _example(path: Path, part: Schema) -> str:
    """What a missing field could look like."""
    if "x-examples" not in part:
        return ""
    return f"write `{path[-1]}: {part['x-examples'][0]}`"


def _sample(part: Schema) -> str:
    if "x-examples" in part:
        return f"write it as in {part['x-examples'][0]}"
    known = list(part.get("properties", {}))
    return f"its fields are {listed(known, 'and')}" if known else ""


def _choice(path: Path, value: Any, part: Schema, context: dict[str, Any]) -> Finding:
    choices = part.get("enum") or [context["expected"].strip("'")]
    one_of = listed(choices) if len(choices) == 1 else f"one of {listed(choices)}"
    hint = did_you_mean(value, choices) if isinstance(value, str) else ""
    if len(choices) == 1 and not hint:
        hint = f"write `{path[-1]}: {choices[0]}`" if isinstance(path[-1], str) else f"write {choices[0]}"
    return Finding(path, f"must be {one_of}, and is {described(value)}", hint)


def _unknown(error: ErrorDetails, schema: Schema) -> Finding:
    """A field that is not there: perhaps misspelt, perhaps in the wrong place."""
    path = error["loc"]
    meant = _meant(error, schema)
    if meant:
        return Finding(path, "there is no such field", f"did you mean `{meant[-1]}`?", reads=(path, meant))
    name = str(path[-1])
    known = list((schema_at(schema, path[:-1]) or {}).get("properties", {}))
    elsewhere = [place for place in _places(schema, name) if place != "status" and not place.startswith("status.")]
    if 0 < len(elsewhere) <= 3:
        hint = f"`{name}` belongs under {listed(elsewhere)}: check the indentation"
    else:
        hint = f"the fields here are {listed(known, 'and')}"
    return Finding(path, "there is no such field", hint)


def _places(schema: Schema, name: str, path: Path = ()) -> Iterator[str]:
    """Objects that have a field of this name."""
    for field, part in schema.get("properties", {}).items():
        if field == name and path:
            yield render(path)
        yield from _places(part, name, (*path, field))
    if "items" in schema:
        yield from (place + "[]" if place == render(path) else place for place in _places(schema["items"], name, path))


def _pattern(value: str, pattern: str) -> tuple[str, str]:
    """What is wrong with a text that does not have the form of its field, and a text that has."""
    match pattern:
        case _ if pattern == NAME_PATTERN:
            message = "must be lower-case letters, digits and dashes, with a letter or digit first and last"
            better = re.sub(r"[^a-z0-9]+", "-", value.lower()).strip("-")
        case _ if pattern == NODE_PATTERN:
            message = "must be lower-case letters, digits, dashes and dots, with a letter or digit first and last"
            better = re.sub(r"[^a-z0-9.]+", "-", value.lower()).strip("-.")
        case _ if pattern == METRIC_PATTERN:
            message = "must be lower-case letters, digits and underscores, with a letter first"
            better = re.sub(r"[^a-z0-9]+", "_", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", value).lower()).strip("_")
            better = better.lstrip("0123456789_")
        case _ if pattern == FUNCTION_PATTERN:
            message = "must be the name of a Python module, a colon, and the name of a function in it"
            better = _as_function(value)
        case _ if pattern == MAC_PATTERN:
            message = "must be a MAC address: six pairs of hexadecimal digits between colons"
            digits = re.sub(r"[^0-9A-Fa-f]", "", value).lower()
            better = ":".join(re.findall("..", digits)) if len(digits) == 12 else "00:1a:2b:3c:4d:5e"
        case _ if pattern == IPV4_PATTERN:
            message, better = "must be an IPv4 address", "192.168.1.255"
        case _:
            message, better = f"must match {pattern}", ""
    fits = bool(better) and re.fullmatch(pattern, better) is not None
    hint = f"write {better}" if fits else "write my_module:my_function" if pattern == FUNCTION_PATTERN else ""
    return f"{message}, and is {described(value)}", hint


def _as_function(value: str) -> str:
    """`module:function` from what was probably meant by `folder/module.py:function` or `module.function`."""
    module, colon, function = value.replace("()", "").strip().partition(":")
    module = module.removeprefix("./").removesuffix(".py").replace("/", ".").replace("-", "_")
    if not colon:
        module, _, function = module.rpartition(".")
    return f"{module}:{function.strip()}" if module and function else "my_module:my_function"

"""FleetSpec, Mission and EdgeNode from YAML and back, with every problem at once."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, Generic, TypeVar

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from fleet.errors import Problem, SpecError
from fleet.spec import messages
from fleet.spec.base import API_VERSION
from fleet.spec.findings import Finding, did_you_mean, nearest
from fleet.spec.repair import empty_fields, repaired, without_nulls
from fleet.spec.resources import EdgeNode, FleetSpec, Mission
from fleet.spec.rules import broken_rules
from fleet.spec.schema import schema_of, walk
from fleet.spec.yaml_text import Document, Path, read_yaml, render, write_yaml

R = TypeVar("R", FleetSpec, Mission, EdgeNode)
_KINDS = ("FleetSpec", "Mission", "EdgeNode")


@dataclass(frozen=True)
class Reading(Generic[R]):
    """What was read of a document.

    Args:
        document: What was read.
        resource: The resource; None when anything is wrong.
        sound: The resource without its broken values; None when too little is left.
        broken: Where broken values were.
        problems: Everything that is wrong, in the order of the document.
    """

    document: Document
    resource: R | None
    sound: R | None
    broken: tuple[Path, ...]
    problems: tuple[Problem, ...]


def load_fleet_spec(path: FilePath) -> FleetSpec:
    """The FleetSpec of a YAML file.

    Raises:
        SpecError: the file cannot be read, or something is wrong with it; has every problem.
    """
    return _resource(read(FleetSpec, read_file(path)), str(path))


def parse_fleet_spec(document: object, source: str = "") -> FleetSpec:
    """The FleetSpec of a document as JSON has it.

    Raises:
        SpecError: has every problem; `source` is where the document is from.
    """
    return _resource(read(FleetSpec, Document(document)), source)


def parse_mission(document: object, source: str = "") -> Mission:
    """The Mission of a document as JSON has it. Raises SpecError as `parse_fleet_spec`."""
    return _resource(read(Mission, Document(document)), source)


def parse_edge_node(document: object, source: str = "") -> EdgeNode:
    """The EdgeNode of a document as JSON has it. Raises SpecError as `parse_fleet_spec`."""
    return _resource(read(EdgeNode, Document(document)), source)


def to_document(resource: FleetSpec | Mission | EdgeNode, *, defaults: bool = False) -> dict[str, Any]:
    """The resource as JSON has it, in camelCase; without what is left at its default, unless `defaults`."""
    given = resource.model_dump(mode="json", by_alias=True, exclude_none=True, exclude_defaults=not defaults)
    return {"apiVersion": resource.api_version, "kind": resource.kind} | given


def to_yaml(resource: FleetSpec | Mission | EdgeNode) -> str:
    """The resource as YAML, without what is left at its default."""
    return write_yaml(to_document(resource))


def read_file(path: FilePath) -> Document:
    """The one document of a YAML file.

    Raises:
        SpecError: the file cannot be read, is not YAML, or has no document or several.
    """
    try:
        documents = read_yaml(path.read_text(encoding="utf-8-sig"), str(path))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise SpecError([Problem("", f"{path} cannot be read: {reason}")], str(path)) from error
    except UnicodeDecodeError as error:
        problem = Problem("", f"{path} is not text in UTF-8", "save it as plain text in UTF-8")
        raise SpecError([problem], str(path)) from error
    if not documents:
        hint = f"begin with `apiVersion: {API_VERSION}` and `kind: FleetSpec`"
        raise SpecError([Problem("", "the file is empty", hint)], str(path))
    if len(documents) > 1:
        kinds = ", ".join(str(_field(document.value, "kind", "no kind")) for document in documents)
        message = f"the file has {len(documents)} documents ({kinds}), and one is wanted"
        raise SpecError(
            [Problem("", message, "put each document into a file of its own", documents[1].line(()))], str(path)
        )
    return documents[0]


def read(model: type[R], document: Document) -> Reading[R]:
    """A resource, and everything that is wrong with it: its parts, repetitions, and the rules between its parts."""
    kind_problems = list(_wrong_kind(model, document.value))
    if kind_problems:
        problems = [finding.problem(document) for finding in kind_problems]
        return Reading(document, None, None, (), tuple(problems))
    schema = schema_of(model)
    value = without_nulls(document.value)
    resource, errors = _validated(model, value)
    told: list[Finding] = [_with_empty(finding, document.value) for finding in messages.findings(errors, schema)]
    told += _repetitions(schema, value)
    broken = (*document.broken, *(place for finding in told for place in finding.reads or (finding.path,)))
    sound = resource or _sound(model, value, errors, schema)
    if sound is not None:
        rules = [finding for finding in broken_rules(sound) if not finding.rests_on(broken)]
        told += [_left_empty(finding, document.value) for finding in rules]
    problems = [finding.problem(document) for finding in told] + list(document.problems)
    problems.sort(key=lambda problem: (problem.line, problem))
    return Reading(document, None if problems else resource, sound, broken, tuple(problems))


def _resource(reading: Reading[R], source: str) -> R:
    if reading.resource is None:
        raise SpecError(list(reading.problems), source)
    return reading.resource


def _field(value: Any, name: str, otherwise: object = None) -> Any:
    return value.get(name, otherwise) if isinstance(value, dict) else otherwise


def _wrong_kind(model: type[R], value: Any) -> Iterator[Finding]:
    """What makes all the rest pointless to check: it is another kind of document."""
    wanted = model.__name__
    if not isinstance(value, dict):
        hint = f"begin with `apiVersion: {API_VERSION}` and `kind: {wanted}`"
        yield Finding((), f"this is {messages.described(value)}, and a {wanted} is a mapping of fields to values", hint)
        return
    kind = value.get("kind")
    if kind != wanted and not isinstance(kind, str):
        yield Finding(("kind",), "is missing" if kind is None else "must be a text", f"write `kind: {wanted}`")
    elif kind != wanted:
        other = f"this is a {kind}, and a {wanted} is wanted"
        yield Finding(("kind",), other, did_you_mean(kind, [wanted], f"give the file that has `kind: {wanted}`"))
        if nearest(kind, [wanted]) is None:
            return
    version = value.get("apiVersion")
    if version != API_VERSION:
        said = "is missing" if version is None else f"must be {API_VERSION}, and is {messages.described(version)}"
        yield Finding(("apiVersion",), said, f"write `apiVersion: {API_VERSION}`")


def _validated(model: type[R], value: Any) -> tuple[R | None, list[ErrorDetails]]:
    """As the API server would: no `"4"` for 4, and no other spelling of a field."""
    try:
        return model.model_validate_json(json.dumps(value), strict=True, by_alias=True, by_name=False), []
    except ValidationError as error:
        return None, error.errors(include_url=False)


def _sound(model: type[R], value: Any, errors: list[ErrorDetails], schema: dict[str, Any]) -> R | None:
    resource = None
    for _ in range(3):
        value = repaired(value, errors, schema)
        if value is None:
            return None
        resource, errors = _validated(model, value)
        if resource is not None:
            break
    return resource


def _with_empty(finding: Finding, value: Any) -> Finding:
    """A field without a value is there for the user, though not for Kubernetes."""
    if finding.message == "is missing" and finding.path in empty_fields(value):
        return Finding(finding.path, "has no value", finding.hint, finding.reads)
    return finding


def _left_empty(finding: Finding, value: Any) -> Finding:
    """A rule that is broken because a field was begun and has no value yet: that field is the place to look."""
    empty = [place for place in empty_fields(value) if place in finding.reads]
    return Finding(empty[0], "has no value", finding.hint, finding.reads) if empty else finding


def _repetitions(schema: dict[str, Any], value: Any) -> Iterator[Finding]:
    """Items of a list that may not be there twice."""
    for path, part, items in walk(schema, value):
        kind = part.get("x-kubernetes-list-type")
        if kind not in {"set", "map"} or not isinstance(items, list):
            continue
        key = part["x-kubernetes-list-map-keys"][0] if kind == "map" else None
        seen: dict[str, int] = {}
        for index, item in enumerate(items):
            name = _field(item, key) if key else item
            place = (*path, index, key) if key else (*path, index)
            if isinstance(name, str) and name in seen:
                first = render((*path, seen[name]))
                yield Finding(place, f'"{name}" is there twice: also at {first}', _distinct_hint(path, key))
            elif isinstance(name, str):
                seen[name] = index


def _distinct_hint(path: Path, key: str | None) -> str:
    if key == "metric":
        return "give both bounds in one goal: {metric: ..., atLeast: ..., atMost: ...}"
    return f"give each of {path[-1]} another {key}" if key else "remove one"

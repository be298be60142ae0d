"""The CRDs keep Kubernetes' rules for structural schemas, defaults and names."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.contract.api_server import refusals

Schema = dict[str, Any]
CRDS = {path.stem: path for path in (Path(__file__).parents[2] / "crds").glob("*.yaml")}
KNOWN = {
    "description", "type", "format", "default", "enum", "pattern", "anyOf", "minimum", "exclusiveMinimum", "maximum",
    "minLength", "maxLength", "minItems", "maxItems", "maxProperties", "x-kubernetes-int-or-string",
    "x-kubernetes-list-type", "x-kubernetes-list-map-keys", "x-kubernetes-validations", "required", "properties",
    "additionalProperties", "items",
}  # fmt: skip


def load(name: str) -> dict[str, Any]:
    document: dict[str, Any] = yaml.safe_load(CRDS[name].read_text(encoding="utf-8"))
    return document


def root(name: str) -> Schema:
    schema: Schema = load(name)["spec"]["versions"][0]["schema"]["openAPIV3Schema"]
    return schema


def parts(schema: Schema, path: str = "") -> Iterator[tuple[str, Schema]]:
    yield path, schema
    for name, part in schema.get("properties", {}).items():
        yield from parts(part, f"{path}.{name}")
    for name in ("items", "additionalProperties"):
        if isinstance(schema.get(name), dict):
            yield from parts(schema[name], f"{path}[]")


def structural_problems(path: str, schema: Schema) -> list[str]:
    """Rules 1 to 4 of structural schemas, and what belongs to them."""
    wrong = [f"{path}: Kubernetes has no field {name}" for name in schema.keys() - KNOWN]
    if schema.get("x-kubernetes-int-or-string"):
        if "type" in schema or schema["anyOf"] != [{"type": "integer"}, {"type": "string"}]:
            wrong.append(f"{path}: int-or-string with a type, or without its two types")
    elif "type" not in schema or "anyOf" in schema:
        wrong.append(f"{path}: no type, or a choice of types")
    if "additionalProperties" in schema and ("properties" in schema or schema["additionalProperties"] is False):
        wrong.append(f"{path}: additionalProperties beside properties")
    if set(schema.get("required", ())) - set(schema.get("properties", {})):
        wrong.append(f"{path}: requires a field that it does not have")
    if schema.get("type") == "array" and "items" not in schema:
        wrong.append(f"{path}: a list of nothing")
    if schema.get("x-kubernetes-list-type") == "map":
        item = schema["items"]
        (key,) = schema["x-kubernetes-list-map-keys"]
        if key not in item["required"] or item["properties"][key]["type"] != "string":
            wrong.append(f"{path}: the key {key} may be left out, or is not a text")
    if path.startswith(".metadata.") and path != ".metadata.name":
        wrong.append(f"{path}: only the name of metadata may be restricted")
    return wrong


@pytest.mark.parametrize("name", CRDS)
def test_schemas_are_structural(name: str) -> None:
    assert [text for path, part in parts(root(name)) for text in structural_problems(path, part)] == []


@pytest.mark.parametrize("name", CRDS)
def test_every_field_is_described(name: str) -> None:
    own = [".apiVersion", ".kind", ".metadata", ".metadata.name"]
    silent = [path for path, part in parts(root(name)) if "description" not in part and not path.endswith("[]")]
    assert [path for path in silent if path not in own] == []


@pytest.mark.parametrize("name", CRDS)
def test_everything_that_rules_read_is_bounded(name: str) -> None:
    """Without bounds, the API server estimates the cost of a rule as too high."""
    spec = root(name)["properties"]["spec"]
    unbounded = [
        path
        for path, part in parts(spec)
        if (part.get("type") == "array" and "maxItems" not in part)
        or ("additionalProperties" in part and "maxProperties" not in part)
        or (part.get("type") == "string" and "enum" not in part and "maxLength" not in part)
    ]
    assert unbounded == []


@pytest.mark.parametrize("name", CRDS)
def test_defaults_are_valid_where_they_stand(name: str) -> None:
    wrong = [
        (path, text)
        for path, part in parts(root(name))
        if "default" in part
        for text in refusals({"type": "object", "properties": {"it": part}}, {"it": part["default"]})
    ]
    assert wrong == []


@pytest.mark.parametrize("name", CRDS)
def test_rules_hold_for_defaults_that_are_not_filled_in(name: str) -> None:
    """The API server tries rules on a default as it stands in the schema."""
    wrong = []
    for path, part in parts(root(name)):
        if isinstance(part.get("default"), dict):
            bare = {key: value for key, value in part.items() if key != "properties"}
            bare["additionalProperties"] = {"type": "integer"}
            wrong += [(path, text) for text in refusals(bare, part["default"])]
    assert wrong == []


@pytest.mark.parametrize(
    ("name", "defaults"),
    [
        ("fleetspecs", [("", {"observedGeneration": -1})]),
        ("missions", [("", {"observedGeneration": -1})]),
        ("edgenodes", []),
    ],
)
def test_status_says_only_that_nobody_has_looked_yet(name: str, defaults: list[tuple[str, Any]]) -> None:
    status = root(name)["properties"]["status"]
    assert [(path, part["default"]) for path, part in parts(status) if "default" in part] == defaults


@pytest.mark.parametrize(
    ("name", "names", "scope", "columns"),
    [
        (
            "fleetspecs",
            ["fleet", "fleets"],
            "Namespaced",
            ["Phase", "Missions", "Coverage", "Accuracy", "Goals", "Age"],
        ),
        (
            "missions",
            ["fm"],
            "Namespaced",
            ["Fleet", "Number", "Phase", "Landed", "Coverage", "Accuracy", "Goals", "Age"],
        ),
        ("edgenodes", ["en"], "Cluster", ["Node", "Role", "Power", "Age"]),
    ],
)
def test_names_scope_and_columns(name: str, names: list[str], scope: str, columns: list[str]) -> None:
    spec = load(name)["spec"]
    (version,) = spec["versions"]
    shown = [column["name"] for column in version["additionalPrinterColumns"] if not column.get("priority")]
    found = (load(name)["metadata"]["name"], spec["names"]["shortNames"], spec["scope"], shown, version["subresources"])
    assert found == (f"{name}.fleetcomputer.io", names, scope, columns, {"status": {}})


@pytest.mark.parametrize("name", CRDS)
def test_columns_show_fields_that_exist(name: str) -> None:
    (version,) = load(name)["spec"]["versions"]
    fields = {path for path, _ in parts(root(name))} | {".metadata.creationTimestamp"}
    columns = [re.sub(r"\[\?\(@\.type==\"\w+\"\)\]", "[]", c["jsonPath"]) for c in version["additionalPrinterColumns"]]
    assert [column for column in columns if column not in fields] == []

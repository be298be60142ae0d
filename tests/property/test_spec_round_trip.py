"""Random resources: what is written is read again, and Kubernetes takes what `fleet` takes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.errors import Problem, SpecError
from fleet.spec.base import duration_s, quantity_value
from fleet.spec.check import check
from fleet.spec.crd import UNOBSERVED
from fleet.spec.load import parse_fleet_spec, to_document, to_yaml
from fleet.spec.yaml_text import read_yaml, write_yaml
from tests.contract.api_server import admitted, refusals
from tests.spec_documents import Document, fleet_documents

CRDS = Path(__file__).parents[2] / "crds"
SCHEMA = yaml.safe_load((CRDS / "fleetspecs.yaml").read_text(encoding="utf-8"))["spec"]["versions"][0]["schema"][
    "openAPIV3Schema"
]

leaves = st.none() | st.booleans() | st.integers(-(2**63), 2**63) | st.floats(allow_nan=False) | st.text(max_size=12)
tricky = st.sampled_from(
    ["1e3", "no", "y", "2018-06-01", "1:20", "017", "~", "", "- a", "a: b", "#", "!!x", ".5", "0x1"]
)
values = st.recursive(
    leaves | tricky,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6) | tricky, inner, max_size=4),
    max_leaves=12,
)


@settings(max_examples=60)
@given(fleet_documents())
def test_a_written_spec_is_read_again(document: Document) -> None:
    spec = parse_fleet_spec(document)
    (read,) = read_yaml(to_yaml(spec))
    assert parse_fleet_spec(read.value) == spec
    assert parse_fleet_spec(to_document(spec)) == spec
    assert parse_fleet_spec(to_document(spec, defaults=True)) == spec
    assert check(spec) == []


@settings(max_examples=60)
@given(fleet_documents())
def test_kubernetes_takes_a_valid_spec_with_the_same_defaults(document: Document) -> None:
    assert refusals(SCHEMA, document) == []
    kept = admitted(SCHEMA, document)
    assert kept.pop("status") == UNOBSERVED
    spec = parse_fleet_spec(kept)
    assert spec == parse_fleet_spec(document)
    written = to_document(spec, defaults=True)
    assert admitted(SCHEMA, written) == written | {"status": UNOBSERVED}


@settings(max_examples=150)
@given(values)
def test_written_yaml_is_read_again(value: Any) -> None:
    read = read_yaml(write_yaml({"value": value}))
    assert [(document.value, document.problems) for document in read] == [({"value": value}, ())]


@settings(max_examples=100)
@given(st.text(max_size=60) | st.text("-: []{}\t\n'\"#&*!|>%@`,?abc123.", max_size=60))
def test_any_text_is_read_or_refused_in_words(text: str) -> None:
    found = [Problem("", "read")]
    try:
        read_yaml(text)
    except SpecError as error:
        found = list(error.problems)
    assert all(problem.message for problem in found)


@settings(max_examples=80)
@given(fleet_documents(), st.data())
def test_any_value_in_the_place_of_a_part_is_told_or_taken(document: Document, data: st.DataObject) -> None:
    part = data.draw(st.sampled_from(sorted(document["spec"])))
    document["spec"][part] = data.draw(values)
    problems: tuple[Problem, ...] = ()
    try:
        parse_fleet_spec(document)
    except SpecError as error:
        problems = error.problems
    assert [problem for problem in problems if not problem.path.startswith("spec.") or not problem.message] == []
    # The CRD and `fleet` agree on what a value must be, whatever it is.
    assert bool(problems) == bool(refusals(SCHEMA, document))


@given(st.integers(0, 10**6), st.sampled_from([("m", 0.001), ("", 1.0), ("k", 1e3), ("Mi", 2.0**20), ("Gi", 2.0**30)]))
def test_quantities_are_what_their_suffix_says(number: int, suffix: tuple[str, float]) -> None:
    assert abs(quantity_value(f"{number}{suffix[0]}") - number * suffix[1]) <= 1e-9 * number * suffix[1]


@given(st.integers(0, 99), st.integers(0, 59), st.integers(0, 59))
def test_durations_add_up(hours: int, minutes: int, seconds: int) -> None:
    assert duration_s(f"{hours}h{minutes}m{seconds}s") == hours * 3600 + minutes * 60 + seconds

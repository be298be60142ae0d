"""The generated reference page."""

from __future__ import annotations

import re

import yaml

from fleet.spec.load import parse_fleet_spec
from fleet.spec.reference import anchors, reference_page


def test_every_link_has_its_heading() -> None:
    page = reference_page()
    links = set(re.findall(r"\]\(#([^)]+)\)", page))
    assert links - set(anchors(page)) == set()


def test_the_example_is_a_valid_spec() -> None:
    (example,) = re.findall(r"```yaml\n(.*?)```", reference_page(), flags=re.DOTALL)
    assert parse_fleet_spec(yaml.safe_load(example)).name == "crop-scouting"


def test_every_field_has_a_type_and_a_meaning() -> None:
    rows = re.findall(r"^\| `(\w+)` \| (.*?) \| (.*?) \| (.*?) \|$", reference_page(), flags=re.MULTILINE)
    assert len(rows) > 100
    assert [name for name, kind, _, meaning in rows if not kind or not meaning] == []

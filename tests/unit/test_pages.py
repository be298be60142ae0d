"""Links of the README and the docs lead somewhere, and what they show of the example is what the example has."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from tests.conftest import ROOT

PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_relative_link_of_a_page_leads_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text())
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert missing == []


def test_the_fleetspec_of_the_readme_is_a_part_of_the_example() -> None:
    (shown,) = re.findall(r"```yaml\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    spec = yaml.safe_load((ROOT / "examples/crop-scouting/fleetspec.yaml").read_text())["spec"]
    for field, value in yaml.safe_load(shown).items():
        for name, part in value.items() if isinstance(value, dict) else ():
            assert spec[field][name] == part
        if not isinstance(value, dict):
            assert spec[field] == value


@pytest.mark.parametrize("command", ["demo", "test", "lint", "bench", "setup", "generate"])
def test_make_has_the_commands_that_pages_name(command: str) -> None:
    assert re.search(rf"^{command}:", (ROOT / "Makefile").read_text(), re.MULTILINE)


def test_every_module_that_the_paper_page_names_exists() -> None:
    names = set(re.findall(r"`(fleet(?:_operator)?\.[a-z_.]+)`", (ROOT / "docs/paper.md").read_text()))
    roots = {"fleet": ROOT, "fleet_operator": ROOT / "operator"}
    missing = []
    for name in sorted(names):
        path = roots[name.split(".")[0]] / name.replace(".", "/")
        if not (path.with_suffix(".py").is_file() or path.is_dir()):
            missing.append(name)
    assert missing == []

"""The snippets of docs/contexts.md and docs/energy.md run as they are, and their YAML is valid."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
import yaml

from fleet.contexts.manifest import parse_manifest
from fleet.energy.profiles import load_aircraft, load_edge

ROOT = Path(__file__).resolve().parents[2]


def snippets(page: str, language: str) -> list[str]:
    return re.findall(
        rf"^```{language}\n(.*?)^```", (ROOT / "docs" / page).read_text("utf-8"), re.MULTILINE | re.DOTALL
    )


@pytest.mark.parametrize("page", ["contexts.md", "energy.md"])
def test_the_snippets_of_a_page_run_one_after_the_other(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(ROOT / "examples" / "crop-scouting" / "contexts", tmp_path / "examples/crop-scouting/contexts")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for snippet in snippets(page, "python"):
        exec(compile(snippet, page, "exec"), names)
    assert capsys.readouterr().out


def test_the_context_yaml_of_the_page_is_valid() -> None:
    whole, part = snippets("contexts.md", "yaml")
    manifest = parse_manifest(whole.encode(), "docs")
    document = {**yaml.safe_load(whole), **yaml.safe_load(part), "features": [{"name": "yield"}]}
    scaled = parse_manifest(yaml.safe_dump(document).encode(), "docs")
    assert (manifest.truth, manifest.pictured, scaled.truth, scaled.pictured) == ("exg", "exg", "yield", "yield")


def test_the_profiles_of_the_page_are_valid(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(snippets("energy.md", "yaml")[0], "utf-8")
    assert load_aircraft("mine.yaml#my-drone", tmp_path).name == "my-drone"
    assert load_edge("mine.yaml#my-box", tmp_path).busy_w == 20.0

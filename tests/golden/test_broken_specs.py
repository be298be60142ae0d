"""What users read when a FleetSpec is broken; `--update-golden` writes the messages anew."""

from __future__ import annotations

from pathlib import Path

import pytest

from fleet.errors import SpecError
from fleet.spec.load import load_fleet_spec

FOLDER = Path(__file__).parent / "broken_specs"
SPECS = sorted(FOLDER.glob("*.yaml"))


def messages(path: Path) -> str:
    with pytest.raises(SpecError) as caught:
        load_fleet_spec(path)
    return "".join(f"{problem}\n" for problem in caught.value.problems)


@pytest.mark.parametrize("path", SPECS, ids=[path.stem for path in SPECS])
def test_messages(path: Path, update_golden: bool) -> None:
    golden = path.with_suffix(".txt")
    said = messages(path)
    if update_golden:
        golden.write_text(said, encoding="utf-8")
    assert said == golden.read_text(encoding="utf-8")


def test_there_are_enough_broken_specs_and_no_message_without_one() -> None:
    assert len(SPECS) >= 30
    assert [path.name for path in FOLDER.glob("*.txt") if not path.with_suffix(".yaml").exists()] == []


@pytest.mark.parametrize("path", SPECS, ids=[path.stem for path in SPECS])
def test_every_message_names_a_line_and_no_library(path: Path) -> None:
    with pytest.raises(SpecError) as caught:
        load_fleet_spec(path)
    for problem in caught.value.problems:
        assert problem.line > 0 or problem.message == "the file is empty"
        assert not [word for word in ("pydantic", "Input should", "PyYAML", "Error") if word in str(problem)]

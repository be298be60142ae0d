"""One command runs the whole evaluation into one folder; a part that fails is told, and none is run twice."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from bench import machine
from bench.scouting import everything
from bench.scouting.everything import PARTS, Form, Part
from bench.scouting.results import write
from tests.conftest import ROOT

COMMIT = "0123456789ab"
PROGRAM = """
import argparse, json, pathlib, sys
parser = argparse.ArgumentParser()
parser.add_argument("--mode", default="well")
parser.add_argument("--workers")
parser.add_argument("--out", type=pathlib.Path)
asked = parser.parse_args()
print(f"table of {asked.out.stem}")
with (asked.out.parent / "flown").open("a") as flown:
    flown.write(asked.out.stem + " ")
if asked.mode != "silent":
    asked.out.write_text(json.dumps({"figure": len(asked.out.stem)}))
sys.exit(3 if asked.mode == "broken" else 0)
"""


class StandIn(Part):
    """A part that is flown at once; `short` says how: "broken" fails, "silent" writes no figures."""

    @property
    def module(self) -> str:
        """A module that the test wrote."""
        return "stand_in_part"


def _part(name: str, mode: str = "well") -> StandIn:
    return StandIn(name, ("--mode", mode))


@pytest.fixture
def form(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Form:
    """A folder, in which stand-ins are flown at a commit."""
    (tmp_path / "stand_in_part.py").write_text(PROGRAM)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setattr(machine, "commit", lambda: COMMIT)
    return Form(tmp_path / "out", True, 1)


def _written(form: Form) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(form.results.read_text())
    return document


def _flown(form: Form) -> list[str]:
    return (form.out / "flown").read_text().split()


def _main(monkeypatch: pytest.MonkeyPatch, form: Form, parts: Sequence[Part], *options: str) -> int:
    monkeypatch.setattr(everything, "PARTS", tuple(parts))
    return everything.main(["--short", "--workers", "1", "--out", str(form.out), *options])


@pytest.mark.parametrize("short", [True, False])
def test_everything_names_commands_that_know_their_options(short: bool) -> None:
    for part in PARTS:
        _, module, *options = Form(Path("out"), short, 1).command(part)
        file = ROOT / (module.replace(".", "/") + ".py")
        program = (file if file.is_file() else file.with_suffix("") / "__main__.py").read_text()
        asked = [option for option in options if option.startswith("--")]
        assert [option for option in asked if f'"{option}"' not in program] == []


def test_a_part_reads_files_of_parts_that_ran_before_it() -> None:
    names = [part.name for part in PARTS]
    assert len(set(names)) == len(names)
    form = Form(Path("out"), False, 2)
    for part in PARTS:
        assert set(part.reads) <= set(names[: names.index(part.name)])
        for other in part.reads:
            command = form.command(part)
            assert command[command.index(f"--{other}") + 1] == str(form.file(other))


def test_the_full_form_leaves_fields_and_seeds_to_the_parts() -> None:
    for part in PARTS:
        assert not {"--short", "--seeds", "--fields", "--goals"} & set(Form(Path("out"), False, 2).command(part))


def test_figures_and_tables_of_all_parts_are_in_one_file_each(form: Form, capfd: pytest.CaptureFixture[str]) -> None:
    assert everything.run(form, [_part("stops"), _part("sizes")]) == []
    written = _written(form)
    assert list(written["parts"]) == ["sizes", "stops"]
    section = written["parts"]["sizes"]
    assert (section["results"], section["tables"], section["exit_code"]) == ({"figure": 5}, "table of sizes\n", 0)
    assert section["command"].startswith("python -m stand_in_part --mode well --workers 1 --out ")
    assert section["machine"]["commit"] == written["machine"]["commit"] == COMMIT
    assert written["seconds"] == pytest.approx(sum(each["seconds"] for each in written["parts"].values()), abs=0.11)
    told = (form.out / "tables.txt").read_text()
    assert told.index("table of sizes") < told.index("table of stops")
    assert section["command"] in told
    assert f"commit {COMMIT}" in told
    assert "table of stops" in capfd.readouterr().out


@pytest.mark.parametrize("mode", ["broken", "silent"])
def test_a_part_that_fails_is_told_and_the_others_run(
    mode: str, form: Form, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    assert _main(monkeypatch, form, [_part("sizes", mode), _part("stops")]) == 1
    parts = _written(form)["parts"]
    assert parts["sizes"]["exit_code"] != 0
    assert parts["sizes"]["results"] is None
    assert parts["sizes"]["tables"] == "table of sizes\n"
    assert parts["stops"]["results"] == {"figure": 5}
    assert capfd.readouterr().err == "failed: sizes\n"


def test_a_run_that_was_broken_off_goes_on_where_it_ended(form: Form) -> None:
    assert everything.run(form, [_part("sizes"), _part("stops", "broken")]) == ["stops"]
    assert everything.run(form, [_part("sizes"), _part("stops", "broken"), _part("late")]) == ["stops"]
    assert _flown(form) == ["sizes", "stops", "stops", "late"]
    assert list(_written(form)["parts"]) == ["sizes", "stops", "late"]


def test_what_another_command_or_commit_gave_is_flown_again(form: Form, monkeypatch: pytest.MonkeyPatch) -> None:
    everything.run(form, [_part("sizes")])
    everything.run(Form(form.out, form.short, 2), [_part("sizes")])
    monkeypatch.setattr(machine, "commit", lambda: "another")
    everything.run(Form(form.out, form.short, 2), [_part("sizes")])
    for _ in range(2):  # nobody knows what changed since
        monkeypatch.setattr(machine, "commit", lambda: "another, changed")
        everything.run(Form(form.out, form.short, 2), [_part("sizes")])
    assert _flown(form) == ["sizes"] * 5


def test_parts_are_chosen_and_flown_afresh_on_demand(form: Form, monkeypatch: pytest.MonkeyPatch) -> None:
    parts = [_part("sizes"), _part("stops")]
    assert _main(monkeypatch, form, parts, "--only", "stops") == 0
    assert _main(monkeypatch, form, parts) == 0
    assert _flown(form) == ["stops", "sizes"]
    assert _main(monkeypatch, form, parts, "--fresh", "--only", "sizes") == 0
    assert _flown(form) == ["stops", "sizes", "sizes"]
    assert list(_written(form)["parts"]) == ["sizes"]


def test_a_commit_is_told_with_a_mark_when_files_differ_from_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "ROOT", tmp_path)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert machine.commit() == "unknown"
    (tmp_path / "file").write_text("one")
    author = ("-c", "user.name=A", "-c", "user.email=a@example.org")
    for command in (("init", "-q"), ("add", "file"), (*author, "commit", "-qm", "first")):
        subprocess.run(["git", *command], cwd=tmp_path, check=True)
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=tmp_path, check=True, capture_output=True, text=True)
    assert machine.commit() == head.stdout[:12]
    (tmp_path / "new").write_text("not of the commit")
    assert machine.commit() == head.stdout[:12]
    (tmp_path / "file").write_text("two")
    assert machine.commit() == f"{head.stdout[:12]}, changed"


def test_facts_name_versions_commit_and_machine() -> None:
    found = machine.facts()
    assert {"fleet", "commit", "python", "numpy", "processor", "cores"} <= set(found)
    assert all(found.values())
    assert int(found["cores"]) == os.cpu_count()


def test_what_is_not_a_number_is_null_in_a_results_file(tmp_path: Path) -> None:
    write(tmp_path / "new" / "file.json", "it", {"runs": [{"a": float("nan"), "b": (1.5, float("inf"))}], "c": "NaN"})
    written = json.loads((tmp_path / "new" / "file.json").read_text())
    assert written == {"command": "it", "runs": [{"a": None, "b": [1.5, None]}], "c": "NaN"}

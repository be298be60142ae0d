"""crds/ and the reference page are what the models say."""

from __future__ import annotations

from pathlib import Path

import pytest

from fleet.spec.generate import ROOT, generated, main, stale, write


def test_generated_files_are_fresh() -> None:
    assert stale(ROOT) == [], "run `python -m fleet.spec.generate`"


def test_generating_is_deterministic() -> None:
    assert generated() == generated()


def test_check_lists_what_is_stale_and_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path)
    (tmp_path / "crds" / "missions.yaml").write_text("old\n")
    (tmp_path / "crds" / "swarms.yaml").write_text("left over\n")
    code = main(["--check", "--root", str(tmp_path)])
    said = capsys.readouterr().out
    assert (code, said) == (
        1,
        "stale: crds/missions.yaml\nstale: crds/swarms.yaml\n"
        "run `python -m fleet.spec.generate` and commit what it writes\n",
    )
    assert (tmp_path / "crds" / "missions.yaml").read_text() == "old\n"


def test_writing_twice_writes_nothing_the_second_time(tmp_path: Path) -> None:
    first = write(tmp_path)
    assert (sorted(generated()), []) == (first, write(tmp_path))
    assert main(["--check", "--root", str(tmp_path)]) == 0

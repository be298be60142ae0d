"""The benchmark harness keeps figures, and says so when a benchmark fails."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType

import pytest

from bench import run as harness
from bench.measure import Result, seconds

GOOD = Result.against("speed", 30.0, "steps/s", ("walking", 10.0), "python -m bench.run good")


def fail() -> list[Result]:
    raise ValueError("no such field")


@pytest.fixture
def benches(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    for name, run in (("good", lambda: [GOOD]), ("bad", fail)):
        module = ModuleType(f"bench.{name}")
        module.run = run  # type: ignore[attr-defined]  # a module made by hand
        monkeypatch.setitem(sys.modules, f"bench.{name}", module)
    monkeypatch.setattr(harness, "names", lambda: ["bad", "good"])
    monkeypatch.setattr(harness, "OUT", tmp_path / "out" / "results.json")
    return tmp_path / "out" / "results.json"


def test_results_have_the_ratio_to_their_peer(benches: Path) -> None:
    assert harness.main(["good"]) == 0
    assert json.loads(benches.read_text()) == [
        {
            "name": "speed", "value": 30.0, "unit": "steps/s", "peer": "walking", "peer_value": 10.0, "ratio": 3.0,
            "command": "python -m bench.run good",
        }
    ]  # fmt: skip


def test_a_failing_benchmark_fails_the_run_and_costs_no_other_figure(
    benches: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert harness.main([]) == 1
    assert [result["name"] for result in json.loads(benches.read_text())] == ["speed"]
    assert "failed: bad" in capsys.readouterr().err


def test_an_unknown_name_is_refused(benches: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert harness.main(["fast"]) == 2
    assert capsys.readouterr().err == "no benchmark fast; there are bad, good\n"
    assert not benches.exists()


def test_warm_up_is_not_timed() -> None:
    calls: list[int] = []
    assert seconds(lambda: calls.append(1), repeats=3, warm_up=2) >= 0.0
    assert len(calls) == 5

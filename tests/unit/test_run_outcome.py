"""What a run says at its end, and how its bars are read from logs."""

from __future__ import annotations

from pathlib import Path

import pytest

from fleet.missions.documents import GoalResult
from fleet.spec.swarm import Goal
from fleet_operator.local.display import Gauge
from fleet_operator.local.ledger import RunDocument
from fleet_operator.local.observe import trainer_gauges
from fleet_operator.local.outcome import miss, show
from fleet_operator.local.service import ModelStanding, Summary


@pytest.mark.parametrize(
    ("goal", "value", "text"),
    [
        (Goal(metric="accuracy", at_least=0.7), 0.65, "accuracy is 0.65, 0.05 below 0.7"),
        (Goal(metric="time_s", at_most=1200), 1333.0, "time_s is 1333, 133 above 1200"),
        (Goal(metric="accuracy", at_least=0.7), None, "Eval() gave no metric accuracy"),
    ],
)
def test_a_missed_goal_says_by_how_much(goal: Goal, value: float | None, text: str) -> None:
    assert miss(GoalResult(goal=goal, value=value, met=False)) == text


def test_of_many_models_the_most_useful_are_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    models = [ModelStanding(str(number), None, 1) for number in range(30)]
    models[20] = ModelStanding("20", 0.5, 4)
    show(Summary(0, (), tuple(models), RunDocument.model_construct(), tmp_path))
    lines = capsys.readouterr().out.splitlines()
    assert lines[1:4] == ["model  usefulness  level", "20          0.500      4", "0               -      1"]
    assert lines[18] == "and 14 less useful ones, which are in the report"


@pytest.mark.parametrize(
    ("line", "gauge"),
    [
        ("2026-11-22 18:02:33,123 INFO shaping: 12/48", Gauge("trainer", 12, 48, "shaping: 12/48")),
        ("2026-11-22 18:02:33,123 INFO epoch 3 of 4", Gauge("trainer", 3, 4, "epoch 3 of 4")),
        ("loss 7/2 is no progress", Gauge("trainer", text="loss 7/2 is no progress")),
        ("", Gauge("trainer")),
    ],
)
def test_the_last_line_of_the_trainers_log_is_its_progress(tmp_path: Path, line: str, gauge: Gauge) -> None:
    log = tmp_path / "trainer.log"
    log.write_text(f"an earlier line 1/2\n{line}\n")
    assert trainer_gauges(log) == [gauge]


def test_a_trainer_without_a_log_has_no_progress_yet(tmp_path: Path) -> None:
    assert trainer_gauges(tmp_path / "none") == [Gauge("trainer")]

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.report import measures


@pytest.mark.parametrize(
    ("metric", "value", "expected"),
    [
        ("accuracy", 0.7125, "71.2 %"),
        ("expected_accuracy", 1.0, "100.0 %"),
        ("uav_energy_j", 284_046.0, "284.0 kJ"),
        ("energy_j", 12.5, "12.5 J"),
        ("time_s", 2832.4, "47 min 12 s"),
        ("time_s", 7500.0, "2 h 5 min"),
        ("time_s", 8.21, "8.2 s"),
        ("time_s", 0.0204, "20 ms"),
        ("mae", 3.11912, "3.119"),
        ("plants", 12.0, "12"),
        ("plants", 1_234_567.8, "1,234,568"),
        ("accuracy", None, "–"),  # noqa: RUF001 - the sign of an empty cell
    ],
)
def test_a_value_is_written_with_a_unit_that_keeps_it_short(metric: str, value: float | None, expected: str) -> None:
    assert measures.text(metric, value) == expected


def test_metrics_that_every_mission_has_come_first() -> None:
    names = ["mae", "energy_j", "coverage", "blur", "time_s", "accuracy"]
    assert measures.ordered(names) == ["accuracy", "coverage", "time_s", "energy_j", "blur", "mae"]


def test_names_of_metrics_become_words() -> None:
    assert [measures.label(name) for name in ("uav_energy_j", "return_time_s", "plants")] == [
        "UAV energy",
        "return time",
        "plants",
    ]


@given(st.floats(min_value=0, max_value=1e7, allow_nan=False))
def test_a_duration_never_has_sixty_seconds_or_minutes(seconds: float) -> None:
    parts = measures.duration(seconds).split()
    numbers = dict(zip(parts[1::2], map(float, parts[::2]), strict=True))
    assert numbers.get("min", 0) < 60
    assert numbers.get("s", 0) <= 60 if len(numbers) == 1 else numbers.get("s", 0) < 60

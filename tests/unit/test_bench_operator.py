"""What the benchmarks of the operator count, and what they make by hand, is what the operator makes."""

from __future__ import annotations

from pathlib import Path

from bench.apply import _as_applied
from bench.operator_scale.fleets import FLOOR, Objects, fleet_spec, name, write_library
from bench.operator_scale.meter import Sample, busiest
from fleet_operator.compiler.settings import Settings
from fleet_operator.resources.applied import applied_hash, mark_of


def _sample(at_s: float, writes: float) -> Sample:
    return Sample(at_s, {"patch": writes, "list": 1000.0, "failed": 5.0}, 1.0, 0.0, 100.0, 1.0)


def test_the_busiest_window_counts_writes_and_is_never_shorter_than_asked() -> None:
    samples = [_sample(float(second), writes) for second, writes in enumerate((0, 10, 110, 210, 215, 216))]
    assert busiest(samples, 2.0) == 100.0
    assert busiest(samples[:2], 5.0) == 2.0
    assert busiest(samples[:1], 5.0) == 0.0


def test_a_fleet_has_thirteen_objects_in_flight_and_fifteen_aggregators_each_with_its_mark(tmp_path: Path) -> None:
    write_library(tmp_path, 2)
    objects = Objects(tmp_path, "file:///nowhere", Settings())
    flight, retraining = objects.flight(1), objects.retraining(1)
    kinds = [each["kind"] for each in flight]
    assert [(kind, kinds.count(kind)) for kind in ("Mission", "Service", "Job")] == [
        ("Mission", 1),
        ("Service", 4),
        ("Job", 8),
    ]
    assert [each["kind"] for each in retraining] == ["Job"] * 15
    assert all(mark_of(each) == applied_hash(each) for each in (*flight, *retraining))
    assert {each["metadata"]["namespace"] for each in (*flight, *retraining)} == {FLOOR}
    assert (tmp_path / name(1) / "own.py").is_file()
    assert fleet_spec(1)["metadata"]["name"] == name(1)


def test_a_job_that_is_made_by_hand_has_nothing_of_the_cluster() -> None:
    controller = {"controller-uid": "u", "batch.kubernetes.io/job-name": "j", "job-name": "j"}
    body = {
        "apiVersion": "batch/v1",
        "kind": "Job",
        "metadata": {
            "name": "j",
            "namespace": "n",
            "uid": "u",
            "resourceVersion": "7",
            "ownerReferences": [{"kind": "FleetSpec"}],
            "labels": {"own": "x", **controller},
            "annotations": {"batch.kubernetes.io/job-tracking": ""},
        },
        "spec": {
            "backoffLimit": 3,
            "selector": {"matchLabels": controller},
            "template": {"metadata": {"labels": {"own": "x", **controller}}, "spec": {"containers": []}},
        },
        "status": {"active": 1},
    }
    assert _as_applied(body) == {
        "apiVersion": "batch/v1",
        "kind": "Job",
        "metadata": {"name": "j", "namespace": "n", "labels": {"own": "x"}, "annotations": {}},
        "spec": {"backoffLimit": 3, "template": {"metadata": {"labels": {"own": "x"}}, "spec": {"containers": []}}},
    }

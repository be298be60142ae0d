"""Jobs, Pods and Nodes in the small, and the hash of what was applied."""

from __future__ import annotations

import json
from typing import Any

import pytest

from fleet_operator.cluster.glance import Head, head_of_event, head_of_object
from fleet_operator.resources import names
from fleet_operator.resources.applied import APPLIED_ANNOTATION, applied_hash, mark_of, marked, seal
from fleet_operator.resources.refs import (
    CONFIG_MAP,
    FLEET_SPEC,
    JOB,
    NODE,
    Manifest,
    ObjectRef,
    kind_of,
)
from fleet_operator.resources.roles import Role
from fleet_operator.resources.views import JobState, JobView, NodeView, PodView, owner_of

OWNER = {"apiVersion": FLEET_SPEC.api_version, "kind": "FleetSpec", "name": "crop", "uid": "f1", "controller": True}
CREATED = "2026-03-01T10:00:00Z"


def job(spec: Manifest | None = None, **status: Any) -> Manifest:
    return {
        "metadata": {
            "name": "crop-m0002-aggregator-3",
            "namespace": "farm",
            "uid": "j1",
            "creationTimestamp": CREATED,
            "ownerReferences": [OWNER],
            "labels": {
                names.FLEET_LABEL: "crop",
                names.ROLE_LABEL: "Aggregator",
                names.MISSION_LABEL: "2",
                names.LEVEL_LABEL: "7",
                names.SUBSET_LABEL: "hashed",
            },
            "annotations": {names.SUBSET_ANNOTATION: "agent-0+agent-1", APPLIED_ANNOTATION: "abc"},
        },
        "spec": spec or {},
        "status": status,
    }


def test_a_job_keeps_what_the_operator_asks_of_it() -> None:
    assert JobView.of(job(ready=1, active=1)) == JobView(
        ref=ObjectRef("farm", "crop-m0002-aggregator-3"),
        uid="j1",
        fleet="crop",
        owner_uid="f1",
        role=Role.AGGREGATOR,
        mission=2,
        agent="",
        subset="agent-0+agent-1",
        level=7,
        applied="abc",
        state=JobState.RUNNING,
        message="",
        created_s=1772359200.0,
        deleting=False,
    )


@pytest.mark.parametrize(
    ("body", "state", "message"),
    [
        (job(), JobState.PENDING, ""),
        (job(active=1, ready=0), JobState.PENDING, ""),
        (job({"suspend": True}), JobState.SUSPENDED, ""),
        (job(active=1, ready=1), JobState.RUNNING, ""),
        (job(conditions=[{"type": "Complete", "status": "True"}]), JobState.SUCCEEDED, ""),
        (
            job(conditions=[{"type": "Failed", "status": "True", "reason": "PodFailurePolicy", "message": "exit 65"}]),
            JobState.FAILED,
            "PodFailurePolicy: exit 65",
        ),
        (job({"suspend": False}, conditions=[{"type": "Suspended", "status": "False"}]), JobState.PENDING, ""),
    ],
)
def test_the_state_of_a_job(body: Manifest, state: JobState, message: str) -> None:
    view = JobView.of(body)
    assert (view.state, view.message) == (state, message)


def test_a_pod_says_why_it_waits() -> None:
    waiting = {"waiting": {"reason": "ImagePullBackOff", "message": "no such image"}}
    body = {
        "metadata": {"name": "p", "namespace": "farm", "labels": {"batch.kubernetes.io/job-name": "j"}},
        "spec": {
            "nodeName": "edge1",
            "initContainers": [{"name": "map"}],
            "containers": [{"name": "workflow", "resources": {"limits": {"cpu": "1"}}}],
        },
        "status": {
            "phase": "Pending",
            "startTime": "1970-01-01T00:01:00Z",
            "initContainerStatuses": [{"restartCount": 2, "state": waiting}],
            "containerStatuses": [{"restartCount": 1, "state": {"waiting": {"reason": "PodInitializing"}}}],
        },
    }
    assert PodView.of(body) == PodView(
        ref=ObjectRef("farm", "p"),
        job="j",
        phase="Pending",
        node="edge1",
        waiting="ImagePullBackOff",
        message="no such image",
        restarts=3,
        containers={"map": {}, "workflow": {"limits": {"cpu": "1"}}},
        started_s=60.0,
    )


def test_a_pod_that_has_no_place_says_so() -> None:
    condition = {"type": "PodScheduled", "status": "False", "reason": "Unschedulable", "message": "0/4 nodes"}
    view = PodView.of({"metadata": {"name": "p"}, "status": {"phase": "Pending", "conditions": [condition]}})
    assert (view.waiting, view.message) == ("Unschedulable", "0/4 nodes")


def test_a_machine_has_its_addresses_and_what_it_can_give() -> None:
    body = {
        "metadata": {"name": "edge1", "labels": {names.ROLE_LABEL: "gateway"}},
        "spec": {"unschedulable": True},
        "status": {
            "allocatable": {"cpu": "1500m", "memory": "4Gi"},
            "conditions": [{"type": "Ready", "status": "True"}],
            "addresses": [{"type": "InternalIP", "address": "10.0.0.2"}, {"type": "Hostname", "address": "edge1"}],
        },
    }
    assert NodeView.of(body) == NodeView("edge1", "gateway", ("edge1", "10.0.0.2"), True, False, 1.5, float(4 * 2**30))


def test_an_object_belongs_to_its_owner_or_to_the_fleet_of_its_label() -> None:
    labelled = {"metadata": {"name": "x", "namespace": "farm", "labels": {names.FLEET_LABEL: "other"}}}
    owned = {"metadata": {**labelled["metadata"], "ownerReferences": [OWNER]}}
    assert [owner_of(owned), owner_of(labelled), owner_of({"metadata": {"name": "x"}})] == [
        ObjectRef("farm", "crop"),
        ObjectRef("farm", "other"),
        None,
    ]


def test_the_hash_is_of_the_content_and_not_of_the_order_or_of_itself() -> None:
    manifest = {"kind": "Job", "metadata": {"name": "a", "annotations": {"x": "1"}}, "spec": {"b": 1, "a": 2}}
    turned = {"spec": {"a": 2, "b": 1}, "metadata": {"annotations": {"x": "1"}, "name": "a"}, "kind": "Job"}
    digest = applied_hash(manifest)
    assert applied_hash(turned) == digest
    assert applied_hash(marked(manifest, digest)) == digest
    assert mark_of(marked(manifest, digest)) == digest
    assert applied_hash({**manifest, "spec": {}}) != digest
    assert json.loads(seal(manifest).text) == marked(manifest, digest)
    assert json.loads(seal(marked(manifest, "old")).text) == marked(manifest, digest)
    bare: Manifest = {"data": {"x": '"metadata":{'}, "metadata": {}}
    assert json.loads(seal(bare).text) == marked(bare, seal(bare).digest)
    assert applied_hash(marked(bare, "other")) == applied_hash(bare)


def test_addresses_are_those_of_the_api() -> None:
    assert JOB.path("farm", "a") == "/apis/batch/v1/namespaces/farm/jobs/a"
    assert CONFIG_MAP.path() == "/api/v1/configmaps"
    assert NODE.path("farm", "edge1") == "/api/v1/nodes/edge1"
    assert kind_of({"apiVersion": "batch/v1", "kind": "Job"}) == JOB
    with pytest.raises(LookupError, match="v1 Secret is not a kind that the operator knows"):
        kind_of({"apiVersion": "v1", "kind": "Secret"})


def test_the_head_of_an_object_is_read_where_the_api_server_writes_it() -> None:
    body = (
        '{"kind":"Job","apiVersion":"batch/v1","metadata":{"name":"a","namespace":"farm","uid":"u1",'
        '"resourceVersion":"17","generation":1,"creationTimestamp":"2026-03-01T10:00:00Z","labels":{}},"spec":{}}'
    )
    head = Head(ObjectRef("farm", "a"), "u1", "17", CREATED)
    assert head_of_object(body.encode()) == head
    assert head_of_event(f'{{"type":"MODIFIED","object":{body}}}'.encode()) == head


@pytest.mark.parametrize(
    "line",
    [
        '{"type":"DELETED","object":{"kind":"Job","apiVersion":"batch/v1","metadata":{"name":"a","namespace":"farm",'
        '"uid":"u1","resourceVersion":"17","creationTimestamp":"2026-03-01T10:00:00Z"}}}',
        '{"type":"ADDED","object":{"apiVersion":"fleetcomputer.io/v1alpha1","kind":"Mission","metadata":{"name":"a"}}}',
        '{"type":"ERROR","object":{"kind":"Status","apiVersion":"v1","metadata":{},"code":410}}',
        '{"type":"BOOKMARK","object":{"kind":"Job","apiVersion":"batch/v1","metadata":{"resourceVersion":"17"}}}',
    ],
)
def test_what_cannot_be_told_at_a_glance_is_not(line: str) -> None:
    assert head_of_event(line.encode()) is None

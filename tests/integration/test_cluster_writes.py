"""What the operator writes to a real API server, and what it is told when that is refused."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from fleet_operator.cluster import errors
from fleet_operator.cluster.connection import connect
from fleet_operator.cluster.credentials import Credentials
from fleet_operator.cluster.shelves import FLEETS
from fleet_operator.resources.refs import CONFIG_MAP, FLEET_SPEC, JOB, SERVICE, Manifest, ObjectRef
from fleet_operator.resources.views import JobState, PodView
from tests.connected import config_map, connected, job, make_namespace, run, until
from tests.spec_documents import fleet_document
from tests.testbed.control_plane import ControlPlane

pytestmark = pytest.mark.xdist_group("control-plane")
NAMESPACE = "operator-writes"


@pytest.fixture(scope="module")
def plane(control_plane: ControlPlane) -> Iterator[ControlPlane]:
    make_namespace(control_plane, NAMESPACE)
    yield control_plane
    control_plane.kubectl("delete", "namespace", NAMESPACE, "--wait=false")


def ref(name: str) -> ObjectRef:
    return ObjectRef(NAMESPACE, name)


def version(plane: ControlPlane, *what: str) -> str:
    return str(plane.get(*what, "-n", NAMESPACE)["metadata"]["resourceVersion"])


def make_fleet(plane: ControlPlane, name: str, **spec: Any) -> Manifest:
    document = fleet_document(**spec)
    document["metadata"] = {"name": name, "namespace": NAMESPACE}
    plane.apply(document)
    body: Manifest = plane.get("fleet", name, "-n", NAMESPACE)
    return body


def test_what_is_so_already_costs_no_call(plane: ControlPlane) -> None:
    calls: Counter[str] = Counter()

    async def scenario() -> None:
        async with connected(plane.kubeconfig, NAMESPACE, lambda verb, status: calls.update([verb])) as connection:
            cluster = connection.cluster
            wanted = [job(NAMESPACE, "twice", "crop"), config_map(NAMESPACE, "twice", a="1")]
            assert [await cluster.apply(manifest) for manifest in wanted] == [True, True]
            before = [version(plane, "job", "twice"), version(plane, "configmap", "twice")]
            assert [await cluster.apply(manifest) for manifest in wanted] == [False, False]
            assert calls["patch"] == 2
            assert await cluster.apply(config_map(NAMESPACE, "twice", a="2"))
            assert [version(plane, "job", "twice") == before[0], version(plane, "configmap", "twice") == before[1]] == [
                True,
                False,
            ]

    run(scenario)


def test_an_operator_that_starts_again_writes_nothing_that_is_so_already(plane: ControlPlane) -> None:
    async def scenario() -> None:
        wanted = [job(NAMESPACE, "again", "crop"), config_map(NAMESPACE, "again", a="1")]
        async with connected(plane.kubeconfig, NAMESPACE) as connection:
            for manifest in wanted:
                await connection.cluster.apply(manifest)
        before = [version(plane, "job", "again"), version(plane, "configmap", "again")]
        async with connected(plane.kubeconfig, NAMESPACE) as connection:
            assert [await connection.cluster.apply(manifest) for manifest in wanted] == [False, False]
        assert [version(plane, "job", "again"), version(plane, "configmap", "again")] == before

    run(scenario)


def test_an_applied_job_is_in_memory_at_once_with_its_hash(plane: ControlPlane) -> None:
    async def scenario() -> None:
        async with connected(plane.kubeconfig, NAMESPACE) as connection:
            await connection.cluster.apply(job(NAMESPACE, "seen", "seen-fleet"))
            (view,) = connection.cluster.jobs(ref("seen-fleet"))
            assert (view.ref, view.state, len(view.applied)) == (ref("seen"), JobState.SUSPENDED, 20)
            await connection.cluster.delete(JOB, view.ref, view.uid)
            assert connection.cluster.jobs(ref("seen-fleet")) == ()

    run(scenario)


def test_a_status_is_written_once_and_never_to_another_fleet_of_the_same_name(plane: ControlPlane) -> None:
    first = make_fleet(plane, "status")

    async def scenario() -> None:
        async with connected(plane.kubeconfig, NAMESPACE) as connection:
            cluster = connection.cluster
            status = {"phase": "Training", "observedGeneration": 1}
            assert await cluster.apply_status(FLEET_SPEC, ref("status"), status)
            assert not await cluster.apply_status(FLEET_SPEC, ref("status"), dict(status))
            body = cluster.fleet(ref("status"))
            assert body is not None
            assert body["status"] == status
            assert body["metadata"]["generation"] == first["metadata"]["generation"]
            with pytest.raises(errors.NotFound):
                await cluster.apply_status(FLEET_SPEC, ref("nobody"), status)
            connection.transport.left_s = lambda: 0.0
            with pytest.raises(errors.NotLeading):
                await cluster.apply_status(FLEET_SPEC, ref("status"), {"phase": "Done"})

    run(scenario)
    entry = first["metadata"]["uid"]
    plane.kubectl("delete", "fleet", "status", "-n", NAMESPACE)
    assert make_fleet(plane, "status")["metadata"]["uid"] != entry

    async def late() -> None:
        async with connected(plane.kubeconfig, NAMESPACE) as connection:
            stale = dict(first, metadata={**first["metadata"], "resourceVersion": "999999999"})
            connection.memory.put(FLEETS, stale)  # as if nothing had been heard of the second one yet
            with pytest.raises(errors.Conflict):
                await connection.cluster.apply_status(FLEET_SPEC, ref("status"), {"phase": "Done"})

    run(late)


def test_deleting_is_for_one_uid_and_what_is_gone_is_fine(plane: ControlPlane) -> None:
    async def scenario() -> None:
        async with connected(plane.kubeconfig, NAMESPACE) as connection:
            cluster = connection.cluster
            await cluster.apply(job(NAMESPACE, "delete", "delete-fleet"))
            (view,) = cluster.jobs(ref("delete-fleet"))
            await cluster.delete(JOB, view.ref, "00000000-0000-0000-0000-000000000000")
            assert cluster.jobs(ref("delete-fleet")) == (view,)
            assert version(plane, "job", "delete")
            await cluster.delete(JOB, view.ref, view.uid)
            await cluster.delete(JOB, view.ref, view.uid)
            await cluster.delete(SERVICE, ref("never-there"))
            await cluster.apply(config_map(NAMESPACE, "delete", a="1"))
            await cluster.delete(CONFIG_MAP, ref("delete"))
            assert await cluster.apply(config_map(NAMESPACE, "delete", a="1"))

    run(scenario)
    assert plane.try_kubectl("get", "job", "delete", "-n", NAMESPACE).returncode == 1
    assert version(plane, "configmap", "delete")


def test_a_job_that_is_on_its_way_out_cannot_be_applied(plane: ControlPlane) -> None:
    held = job(NAMESPACE, "held", "held-fleet")
    plane.apply(held | {"metadata": {**held["metadata"], "finalizers": ["test.fleetcomputer.io/held"]}})

    async def scenario() -> None:
        async with connected(plane.kubeconfig, NAMESPACE) as connection:
            await connection.cluster.delete(JOB, ref("held"))
            (view,) = connection.cluster.jobs(ref("held-fleet"))
            assert view.deleting
            with pytest.raises(errors.Conflict, match="is being deleted"):
                await connection.cluster.apply(held)

    run(scenario)
    plane.kubectl("patch", "job", "held", "-n", NAMESPACE, "--type=merge", "-p", '{"metadata":{"finalizers":null}}')


def test_refusals_carry_the_words_of_the_server(plane: ControlPlane) -> None:
    async def scenario() -> None:
        async with connected(plane.kubeconfig, NAMESPACE) as connection:
            cluster = connection.cluster
            bad = job(NAMESPACE, "bad", "crop")
            bad["spec"]["template"]["spec"]["restartPolicy"] = "Always"
            with pytest.raises(errors.Invalid, match=r"spec\.template\.spec\.restartPolicy"):
                await cluster.apply(bad)
            changed = job(NAMESPACE, "fixed", "crop")
            await cluster.apply(changed)
            changed["spec"]["template"]["spec"]["containers"][0]["image"] = "other"
            with pytest.raises(errors.Invalid, match="field is immutable"):
                await cluster.apply(changed)
            with pytest.raises(errors.NotFound, match="namespaces"):
                await cluster.apply(config_map("no-such-namespace", "a"))

    run(scenario)


def test_a_quota_that_is_used_up_is_forbidden_and_named(plane: ControlPlane) -> None:
    quota = {"apiVersion": "v1", "kind": "ResourceQuota", "metadata": {"name": "few", "namespace": NAMESPACE}}
    plane.apply({**quota, "spec": {"hard": {"count/services": "0"}}})

    async def scenario() -> None:
        async with connected(plane.kubeconfig, NAMESPACE) as connection:
            metadata = {"name": "one", "namespace": NAMESPACE, "labels": {"fleetcomputer.io/fleet": "crop"}}
            service = {"apiVersion": "v1", "kind": "Service", "metadata": metadata}
            with pytest.raises(errors.Forbidden, match="exceeded quota: few"):
                await connection.cluster.apply({**service, "spec": {"clusterIP": "None", "selector": {"a": "b"}}})

    plane.kubectl("wait", "--for=jsonpath={.status.hard}", "resourcequota/few", "-n", NAMESPACE)
    run(scenario)
    plane.kubectl("delete", "resourcequota", "few", "-n", NAMESPACE)


def test_what_rbac_refuses_is_forbidden_but_an_event_is_not_worth_an_error(plane: ControlPlane) -> None:
    body = make_fleet(plane, "forbidden")

    async def scenario() -> None:
        poor = connect(Credentials({"KUBECONFIG": str(plane.user("nobody"))}), ref("lease"))
        async with poor.transport:
            with pytest.raises(errors.Forbidden, match='User "nobody" cannot patch resource "configmaps"'):
                await poor.cluster.apply(config_map(NAMESPACE, "forbidden"))
            await poor.cluster.record(body, "Normal", "Told", "Nobody may say so.")

    run(scenario)


def test_an_event_that_repeats_is_counted_also_by_the_next_operator(plane: ControlPlane) -> None:
    body = make_fleet(plane, "story")

    async def tell(times: int) -> None:
        async with connected(plane.kubeconfig, NAMESPACE) as connection:
            for _ in range(times):
                await connection.cluster.record(body, "Warning", "ImageMissing", "x" * 2000)
                await connection.cluster.record(body, "Normal", "Training", "The first model is trained.")
            warned = await connection.cluster.complaints(ref("story"), "FleetSpec")
            assert [(reason, len(message)) for reason, message in warned] == [("ImageMissing", 1024)]

    run(lambda: tell(2))
    run(lambda: tell(1))
    events = plane.get("events", "-n", NAMESPACE, "--field-selector=involvedObject.name=story")["items"]
    assert sorted((event["type"], event["reason"], event["count"]) for event in events) == [
        ("Normal", "Training", 3),
        ("Warning", "ImageMissing", 3),
    ]
    assert "ImageMissing" in plane.kubectl("describe", "fleet", "story", "-n", NAMESPACE)


def test_pods_and_complaints_of_a_job_are_found(plane: ControlPlane) -> None:
    async def scenario() -> None:
        async with connected(plane.kubeconfig, NAMESPACE) as connection:
            cluster = connection.cluster
            manifest = job(NAMESPACE, "pods", "pods-fleet", suspend=False)
            manifest["spec"]["template"]["metadata"] = {"labels": {"fleetcomputer.io/fleet": "pods-fleet"}}
            await cluster.apply(manifest)
            pods: tuple[PodView, ...] = ()
            while not pods:
                pods = await cluster.pods(ref("pods-fleet"), "pods")
            assert [(pod.job, pod.phase) for pod in pods] == [("pods", "Pending")]
            assert await cluster.pods(ref("pods-fleet"), "other") == ()
            assert await cluster.pods(ref("pods-fleet")) == pods
            gone = replace(pods[0], ref=ref("no-such-pod"))
            assert not await cluster.resize(gone, "main", {"limits": {"cpu": "1"}})
            await until(lambda: cluster.jobs(ref("pods-fleet"))[0].state is JobState.PENDING)

    run(scenario)

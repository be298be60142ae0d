"""The port to the cluster as the reconciler uses it: the one in memory does what the real one does."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

import pytest

from fleet.spec.load import parse_fleet_spec
from fleet.spec.resources import FleetStatus, MissionStatus
from fleet_operator.cluster.connection import connect
from fleet_operator.cluster.credentials import Credentials
from fleet_operator.cluster.errors import NotFound
from fleet_operator.cluster.port import Cluster
from fleet_operator.compiler.missions import mission_manifest, sensor_job, sensor_service
from fleet_operator.compiler.target import Owner, Target
from fleet_operator.flow.files import to_config_maps
from fleet_operator.policy.status import status_manifest
from fleet_operator.resources import names
from fleet_operator.resources.refs import FLEET_SPEC, JOB, MISSION, Manifest, ObjectRef
from fleet_operator.resources.roles import Role
from fleet_operator.resources.views import JobState, JobView
from tests.conftest import ROOT
from tests.fleet_runs import spec_document
from tests.memory_cluster import MemoryCluster
from tests.testbed.control_plane import ControlPlane

Place = tuple[Cluster, Manifest]
NAMESPACE = "port"
FLEET = ObjectRef(NAMESPACE, "plots")
SENSOR = ObjectRef(NAMESPACE, "plots-m0001-sensor-agent-1")
FILES = to_config_maps("plots", {"own.py": b"x = 1\n", "deep/model.npz": b"\xff\x00"})


def fleet_spec() -> Manifest:
    document = spec_document()
    document["metadata"]["namespace"] = NAMESPACE
    return document


def files() -> list[Manifest]:
    return [{**each, "metadata": {**each["metadata"], "namespace": NAMESPACE}} for each in FILES]


def target(fleet: Manifest) -> Target:
    spec = parse_fleet_spec({key: value for key, value in fleet.items() if key != "status"})
    owner = Owner(FLEET_SPEC.api_version, FLEET_SPEC.kind, FLEET.name, fleet["metadata"]["uid"])
    return Target(spec, owner=owner)


def ordered(manifest: Manifest, order: str) -> Manifest:
    annotations = {**manifest["metadata"].get("annotations", {}), names.ORDER_ANNOTATION: order}
    return {**manifest, "metadata": {**manifest["metadata"], "annotations": annotations}}


async def jobs_are_seen_as_soon_as_they_are_applied(cluster: Cluster, fleet: Manifest) -> None:
    manifest = ordered(sensor_job(target(fleet), 1, "agent-1"), "first")
    assert [await cluster.apply(manifest), await cluster.apply(manifest)] == [True, False]
    (job,) = cluster.jobs(FLEET)
    assert plain(job) == (SENSOR, "plots", fleet["metadata"]["uid"], Role.SENSOR, 1, "agent-1", "first")
    assert (job.state, job.deleting, job.message) == (JobState.PENDING, False, "")
    await cluster.delete(JOB, SENSOR, "another-uid")
    assert cluster.jobs(FLEET) == (job,)
    await cluster.delete(JOB, SENSOR, job.uid)
    assert [each for each in cluster.jobs(FLEET) if not each.deleting] == []
    await cluster.delete(JOB, ObjectRef(NAMESPACE, "never-was"))


def plain(job: JobView) -> tuple[object, ...]:
    return (job.ref, job.fleet, job.owner_uid, job.role, job.mission, job.agent, job.order)


async def what_is_only_made_is_applied_once_too(cluster: Cluster, fleet: Manifest) -> None:
    service = sensor_service(target(fleet), 1, "agent-1")
    assert [await cluster.apply(service), await cluster.apply(service)] == [True, False]


async def missions_have_their_status(cluster: Cluster, fleet: Manifest) -> None:
    ref = ObjectRef(NAMESPACE, "plots-m0001")
    with pytest.raises(NotFound):
        await cluster.apply_status(MISSION, ObjectRef(NAMESPACE, "plots-m0009"), {"phase": "Flying"})
    assert await cluster.apply(mission_manifest(target(fleet), 1))
    status = status_manifest(MissionStatus(phase="Flying", landed="0/2"))
    assert [await cluster.apply_status(MISSION, ref, status) for _ in range(2)] == [True, False]
    body = cluster.missions(FLEET)[1]
    assert (body["spec"]["number"], body["status"]["phase"]) == (1, "Flying")
    assert await cluster.apply_status(MISSION, ref, status_manifest(MissionStatus(phase="Succeeded")))
    assert cluster.missions(FLEET)[1]["status"].get("landed", "") == ""
    await cluster.delete(MISSION, ref)
    assert dict(cluster.missions(FLEET)) == {}


async def the_fleetspec_keeps_what_is_said_of_it(cluster: Cluster, fleet: Manifest) -> None:
    assert FLEET in cluster.fleets()
    assert (fleet["metadata"]["generation"], fleet["spec"]["agents"]["count"]) == (1, 2)
    status = status_manifest(FleetStatus(phase="Training", observed_generation=1))
    assert [await cluster.apply_status(FLEET_SPEC, FLEET, status) for _ in range(2)] == [True, False]
    seen = cluster.fleet(FLEET)
    assert seen is not None
    assert (seen["status"]["phase"], seen["metadata"]["generation"]) == ("Training", 1)
    await cluster.record(seen, "Normal", "Trained", "the first model is in storage")


async def files_are_those_of_the_fleet(cluster: Cluster, fleet: Manifest) -> None:
    found = cluster.files(FLEET)
    assert [each["metadata"]["name"] for each in found] == ["plots-files-1"]
    assert found[0]["data"].keys() | found[0]["binaryData"].keys() == {"000-deep.model.npz", "001-own.py"}
    assert cluster.files(ObjectRef(NAMESPACE, "other")) == ()


async def nothing_is_wrong_where_nothing_is(cluster: Cluster, fleet: Manifest) -> None:
    assert await cluster.pods(FLEET, "never-was") == ()
    assert await cluster.complaints(ObjectRef(NAMESPACE, "never-was"), "Job") == ()


CONTRACT: list[Callable[[Cluster, Manifest], Awaitable[None]]] = [
    jobs_are_seen_as_soon_as_they_are_applied,
    what_is_only_made_is_applied_once_too,
    missions_have_their_status,
    the_fleetspec_keeps_what_is_said_of_it,
    files_are_those_of_the_fleet,
    nothing_is_wrong_where_nothing_is,
]


@pytest.mark.parametrize("law", CONTRACT)
def test_the_cluster_in_memory(law: Any) -> None:
    cluster = MemoryCluster()
    for manifest in (fleet_spec(), *files()):
        cluster.put(manifest)
    fleet = cluster.fleet(FLEET)
    assert fleet is not None
    asyncio.run(law(cluster, fleet))


@pytest.mark.xdist_group("control-plane")
@pytest.mark.parametrize("law", CONTRACT)
def test_the_cluster_behind_an_api_server(control_plane: ControlPlane, law: Any) -> None:
    async def run() -> None:
        async with real(control_plane) as (cluster, fleet):
            await law(cluster, fleet)

    asyncio.run(run())


@contextlib.asynccontextmanager
async def real(plane: ControlPlane) -> AsyncIterator[Place]:
    for crd in sorted((ROOT / "crds").glob("*.yaml")):
        plane.kubectl("apply", "--server-side", "-f", str(crd))
    plane.kubectl("wait", "--for=condition=Established", "crd", "--all")
    plane.apply({"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": NAMESPACE}})
    plane.kubectl("delete", "fleetspec", "--all", "-n", NAMESPACE)
    plane.apply(fleet_spec(), *files())
    connection = connect(
        Credentials({"KUBECONFIG": str(plane.kubeconfig)}), ObjectRef(NAMESPACE, "operator"), (NAMESPACE,)
    )
    async with connection.transport:
        watching = asyncio.create_task(connection.watches.run())
        try:
            await connection.watches.synced()
            await connection.watches.refresh_fleets()
            fleet = connection.cluster.fleet(FLEET)
            assert fleet is not None
            yield connection.cluster, fleet
        finally:
            watching.cancel()
            await asyncio.gather(watching, return_exceptions=True)
    await asyncio.sleep(0.1)  # aiohttp closes TLS connections a moment after its session

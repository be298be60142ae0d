"""The memory of the operator follows a real API server, whatever happens to the connection."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fleet_operator.cluster.connection import Connection
from fleet_operator.cluster.memory import Listeners
from fleet_operator.resources.refs import CONFIG_MAP, JOB, Manifest, ObjectRef
from fleet_operator.resources.views import JobState
from tests.connected import config_map, connected, job, make_namespace, run, until
from tests.spec_documents import fleet_document
from tests.testbed.access import write_kubeconfig
from tests.testbed.control_plane import ControlPlane
from tests.wire import Wire

pytestmark = pytest.mark.xdist_group("control-plane")
NAMESPACE = "operator-watches"


@pytest.fixture(scope="module")
def plane(control_plane: ControlPlane) -> Iterator[ControlPlane]:
    make_namespace(control_plane, NAMESPACE)
    yield control_plane
    control_plane.kubectl("delete", "namespace", NAMESPACE, "--wait=false")


def ref(name: str) -> ObjectRef:
    return ObjectRef(NAMESPACE, name)


def fleet(name: str, **spec: Any) -> Manifest:
    document = fleet_document(**spec)
    document["metadata"] = {"name": name, "namespace": NAMESPACE}
    return document


def files(name: str, fleet_name: str, text: str) -> Manifest:
    manifest = config_map(NAMESPACE, name, **{"crop.py": text})
    manifest["metadata"]["labels"] = {"fleetcomputer.io/files": fleet_name}
    return manifest


class Ears:
    """What the memory tells."""

    def __init__(self, connection: Connection) -> None:
        self.changed: set[ObjectRef] = set()
        self.gone: list[ObjectRef] = []
        connection.memory.listeners = Listeners(self.changed.add, lambda ref, last: self.gone.append(ref))


def service(name: str, selected: str) -> Manifest:
    labels = {"fleetcomputer.io/fleet": "crop"}
    spec = {"clusterIP": "None", "selector": {"is": selected}}
    metadata = {"name": name, "namespace": NAMESPACE, "labels": labels}
    return {"apiVersion": "v1", "kind": "Service", "metadata": metadata, "spec": spec}


def policy(name: str) -> Manifest:
    labels = {"fleetcomputer.io/fleet": "crop"}
    metadata = {"name": name, "namespace": NAMESPACE, "labels": labels}
    spec = {"podSelector": {"matchLabels": labels}, "policyTypes": ["Ingress"]}
    return {"apiVersion": "networking.k8s.io/v1", "kind": "NetworkPolicy", "metadata": metadata, "spec": spec}


async def there(plane: ControlPlane, *args: str, stdin: str | None = None) -> str:
    """kubectl, while the memory goes on following."""
    return await asyncio.to_thread(plane.kubectl, "-n", NAMESPACE, *args, stdin=stdin)


def test_changes_of_others_are_seen_and_kopf_leaves_no_trace(plane: ControlPlane) -> None:
    async def scenario() -> None:
        async with connected(plane.kubeconfig, NAMESPACE, kopf=True) as connection:
            cluster, ears = connection.cluster, Ears(connection)
            await asyncio.to_thread(plane.apply, fleet("seen"), job(NAMESPACE, "j1", "seen"), files("f1", "seen", "1"))
            await until(lambda: cluster.fleet(ref("seen")) and cluster.jobs(ref("seen")) and cluster.files(ref("seen")))
            assert cluster.files(ref("seen"))[0]["data"] == {"crop.py": "1"}
            assert ears.changed == {ref("seen")}

            await there(plane, "patch", "fleet", "seen", "--type=merge", "-p", '{"spec":{"suspend":true}}')
            body = await until(lambda: (now := cluster.fleet(ref("seen"))) and now["spec"]["suspend"] and now)
            kept = plane.get("fleet", "seen", "-n", NAMESPACE, "--show-managed-fields")
            assert {"finalizers", "annotations"}.isdisjoint(kept["metadata"])
            assert {entry["manager"] for entry in kept["metadata"].pop("managedFields")} <= {"kubectl", "kubectl-patch"}
            assert body == kept
            assert plane.get("events", "-n", NAMESPACE, "--field-selector=involvedObject.name=seen")["items"] == []

            await there(plane, "delete", "job", "j1")
            await until(lambda: not cluster.jobs(ref("seen")))
            await there(plane, "delete", "fleet", "seen")
            await until(lambda: ears.gone == [ref("seen")])
            assert cluster.fleets() == ()

    run(scenario)


def test_after_a_broken_wire_and_another_api_server_the_memory_is_right(plane: ControlPlane, tmp_path: Path) -> None:
    plane.apply(fleet("stays"), fleet("goes"), job(NAMESPACE, "stays", "stays"), job(NAMESPACE, "goes", "stays"))
    plane.apply(files("stays", "stays", "1"), files("goes", "stays", "1"))

    def meanwhile() -> None:
        plane.kubectl("-n", NAMESPACE, "delete", "fleet/goes", "job/goes", "configmap/goes")
        plane.apply(fleet("comes"), job(NAMESPACE, "comes", "stays"), files("stays", "stays", "2"))
        plane.restart_api_server()  # it does not know the history from before, and says 410 Gone

    async def scenario() -> None:
        async with Wire(int(plane.url.rsplit(":", 1)[1])) as wire:
            user = {"token": plane.token}
            path = write_kubeconfig(tmp_path / "wire", f"https://127.0.0.1:{wire.port}", plane.ca, user)
            async with connected(path, NAMESPACE, kopf=True) as connection:
                cluster, ears = connection.cluster, Ears(connection)
                assert set(cluster.fleets()) == {ref("stays"), ref("goes")}
                # Until kopf has been heard of, its watch is not there to be broken.
                await there(plane, "annotate", "fleet", "stays", "heard=1")
                await until(lambda: ears.changed)
                wire.cut()
                meanwhile()  # in this thread: the test bed's programs end with the thread that started them
                wire.mend()
                await until(lambda: set(cluster.fleets()) == {ref("stays"), ref("comes")})
                await until(lambda: {view.ref.name for view in cluster.jobs(ref("stays"))} == {"stays", "comes"})
                await until(lambda: [body["data"]["crop.py"] for body in cluster.files(ref("stays"))] == ["2"])
                assert ears.gone == [ref("goes")]
                await there(plane, "annotate", "fleet", "stays", "heard=2", "--overwrite")
                await until(
                    lambda: (now := cluster.fleet(ref("stays"))) and "2" in now["metadata"]["annotations"].values()
                )
                await there(plane, "delete", "job", "comes")
                await until(lambda: len(cluster.jobs(ref("stays"))) == 1)
                assert connection.watches.stalled() == ""

    run(scenario)


def test_a_job_is_followed_from_suspended_to_failed(plane: ControlPlane) -> None:
    async def scenario() -> None:
        async with connected(plane.kubeconfig, NAMESPACE) as connection:
            cluster = connection.cluster
            hopeless = job(NAMESPACE, "hopeless", "followed")
            hopeless["spec"]["activeDeadlineSeconds"] = 1
            await cluster.apply(hopeless)
            assert cluster.jobs(ref("followed"))[0].state is JobState.SUSPENDED
            hopeless["spec"]["suspend"] = False
            await cluster.apply(hopeless)
            assert cluster.jobs(ref("followed"))[0].state is JobState.PENDING
            await until(lambda: cluster.jobs(ref("followed"))[0].state is JobState.FAILED)
            assert cluster.jobs(ref("followed"))[0].message.startswith("DeadlineExceeded")
            await cluster.delete(JOB, ref("hopeless"))
            await cluster.delete(CONFIG_MAP, ref("never-there"))

    run(scenario)


MADE = [
    (service("made", "ours"), '{"spec":{"selector":{"is":"another"}}}'),
    (policy("made"), '{"spec":{"policyTypes":["Egress"]}}'),
    (config_map(NAMESPACE, "made", a="1"), '{"data":{"a":"2"}}'),
]


@pytest.mark.parametrize(("manifest", "change"), MADE, ids=["Service", "NetworkPolicy", "ConfigMap"])
def test_what_the_operator_made_is_made_again_when_somebody_deletes_or_changes_it(
    plane: ControlPlane, manifest: Manifest, change: str
) -> None:
    what = f"{manifest['kind']}/made"

    async def scenario() -> None:
        async with connected(plane.kubeconfig, NAMESPACE) as connection:
            assert await connection.cluster.apply(manifest)
            ears = Ears(connection)
            for act in (["delete", what], ["patch", what, "--type=merge", "-p", change]):
                await asyncio.sleep(0.5)
                ears.changed.clear()
                assert not await connection.cluster.apply(manifest)
                await there(plane, *act)
                await until(lambda: ears.changed == {ref("crop")})
                assert await connection.cluster.apply(manifest)
        now = plane.get(manifest["kind"], "made", "-n", NAMESPACE)
        for part in {"data", "spec"} & manifest.keys():
            assert {key: now[part][key] for key in manifest[part]} == manifest[part]

    run(scenario)

"""What the compiler decides beside what the golden manifests show: places, volumes, networks, new limits."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.errors import SpecError
from fleet.spec.resources import FleetSpec
from fleet_operator.compiler.missions import aggregator_job, aggregator_resources, training_job, workflow_job
from fleet_operator.compiler.network import network_policies, storage_ports
from fleet_operator.compiler.placement import MOST_NODES, affinity
from fleet_operator.compiler.resizing import resizes
from fleet_operator.compiler.settings import Settings
from fleet_operator.compiler.target import AggregatorTerms, Placement, Target
from fleet_operator.compiler.volumes import storage_folder
from fleet_operator.policy.shares import Capacity, Share
from fleet_operator.resources.roles import Role
from tests.spec_documents import fleet_document

MIB = 2**20
VOLUME = Settings(storage_uri="file:///fleet/storage", storage_claim="data")


def target(settings: Settings | None = None, **spec: Any) -> Target:
    return Target(FleetSpec.model_validate(fleet_document(**spec)), settings=settings or Settings())


def terms(subset: str, cores: float, mebibytes: int) -> AggregatorTerms:
    capacity = Capacity(cores, mebibytes * MIB)
    return AggregatorTerms(subset, 5, Share(capacity, Capacity(cores / 10, mebibytes * MIB / 10)))


@given(st.dictionaries(st.from_regex(r"edge-[0-9]{1,4}", fullmatch=True), st.integers(0, 2**40), min_size=1))
def test_the_more_of_the_data_a_node_has_the_better_and_the_hub_always_does(nodes: dict[str, int]) -> None:
    found = affinity(Role.AGGREGATOR, Placement(nodes))
    assert found is not None
    rules = found["nodeAffinity"]
    data, hub = (
        each["matchExpressions"][0]
        for each in rules["requiredDuringSchedulingIgnoredDuringExecution"]["nodeSelectorTerms"]
    )
    assert (data["key"], hub) == (
        "kubernetes.io/hostname",
        {"key": "fleetcomputer.io/role", "operator": "In", "values": ["hub"]},
    )
    assert set(data["values"]) <= set(nodes)
    assert len(data["values"]) == min(len(nodes), MOST_NODES)
    preferred = rules["preferredDuringSchedulingIgnoredDuringExecution"]
    weights = {each["preference"]["matchExpressions"][0]["values"][0]: each["weight"] for each in preferred}
    assert all(1 <= weight <= 100 for weight in weights.values())
    ordered = sorted(weights, key=lambda node: nodes[node])
    assert [weights[node] for node in ordered] == sorted(weights.values())
    assert max(nodes.values()) == max(nodes[node] for node in weights)


def test_an_aggregator_without_a_known_place_runs_anywhere() -> None:
    for placement in (None, Placement()):
        pod = aggregator_job(target(), 1, AggregatorTerms("1", 5), placement)["spec"]["template"]["spec"]
        assert "affinity" not in pod


@pytest.mark.parametrize(
    ("uri", "ports"),
    [
        ("webhdfs://fleet@namenode:9870/fleet", (9864, 9870)),
        ("webhdfs://fleet@one:50070,two:50071/fleet", (9864, 9870, 50070, 50071)),
        ("webhdfs://namenode/fleet", (9864, 9870)),
        ("file:///fleet/storage", ()),
        ("https://user:12@store.farm/fleet", (443, 9864, 9870)),
    ],
)
def test_pods_reach_the_ports_of_their_storage(uri: str, ports: tuple[int, ...]) -> None:
    assert storage_ports(target(storage={"uri": uri})) == ports


def test_an_installation_may_want_no_network_policies() -> None:
    assert network_policies(target(Settings(network_policies=False))) == []


def test_no_policy_lets_a_pod_reach_the_api_server() -> None:
    rules = [rule for policy in network_policies(target()) for rule in policy["spec"].get("egress", ())]
    open_to_all = {port["port"] for rule in rules if "to" not in rule for port in rule["ports"]}
    assert open_to_all.isdisjoint({443, 6443})
    assert all("ports" in rule for rule in rules)


def test_a_folder_as_storage_is_mounted_where_the_platform_reaches_it() -> None:
    pod = workflow_job(target(VOLUME), 1, "agent-1")["spec"]["template"]["spec"]
    mounted = {
        each["name"]: [mount["mountPath"] for mount in each["volumeMounts"]]
        for each in (*pod["initContainers"], *pod["containers"])
    }
    assert mounted == {"map": ["/tmp"], "eval": ["/tmp"], "workflow": ["/tmp", "/fleet/storage"]}
    assert {"name": "storage", "persistentVolumeClaim": {"claimName": "data"}} in pod["volumes"]


def test_a_user_function_is_not_told_where_the_storage_is() -> None:
    pod = workflow_job(target(), 1, "agent-1")["spec"]["template"]["spec"]
    told = {each["name"] for each in (*pod["initContainers"], *pod["containers"]) if "FLEET_STORAGE_URI" in str(each)}
    assert told == {"workflow"}


def test_a_fleet_that_names_a_folder_which_no_volume_holds_is_refused() -> None:
    assert storage_folder(target(VOLUME, storage={"uri": "file:///fleet/storage/of-crops"})) == "/fleet/storage"
    assert storage_folder(target(VOLUME, storage={"uri": "webhdfs://elsewhere/fleet"})) == ""
    with pytest.raises(SpecError) as caught:
        storage_folder(target(VOLUME, storage={"uri": "file:///fleet/storage-2"}))
    assert str(caught.value) == (
        "spec.storage.uri: no volume holds the folder /fleet/storage-2; "
        "leave it out, or write a folder below file:///fleet/storage"
    )


@pytest.mark.parametrize("folder", ["/fleet/storage/../../etc", "/fleet/storage/%2e%2e/x", "/fleet/storage/a/../b"])
def test_a_folder_that_leads_out_of_its_volume_is_refused(folder: str) -> None:
    with pytest.raises(SpecError, match="no volume holds the folder"):
        storage_folder(target(VOLUME, storage={"uri": f"file://{folder}"}))


@pytest.mark.parametrize("functions", [{}, {"map": {"image": "map:1"}, "eval": {"image": "eval:1"}}])
def test_no_container_can_put_what_another_one_runs(functions: dict[str, Any]) -> None:
    fleet = target(**functions)
    for job in (workflow_job(fleet, 1, "agent-1"), training_job(fleet)):
        pod = job["spec"]["template"]["spec"]
        containers = [*pod.get("initContainers", []), *pod["containers"]]
        writable = [
            mount["name"] for each in containers for mount in each["volumeMounts"] if not mount.get("readOnly", False)
        ]
        assert len(set(writable)) == len(writable)
        assert {each["name"] for each in pod["volumes"] if "emptyDir" in each} == set(writable)
        for each in containers:
            variables = {variable["name"]: variable["value"] for variable in each["env"]}
            if each["image"] == fleet.settings.runtime_image:
                assert (variables["PYTHONSAFEPATH"], each["workingDir"]) == ("1", "/")


def test_running_aggregators_get_what_others_have_left() -> None:
    running = {
        key: {"requests": {"cpu": "50m", "memory": "160Mi"}, "limits": {"cpu": "1", "memory": "512Mi"}}
        for key in ("1", "2", "1-2")
    }
    wanted = [terms("1", 2.0, 1024), terms("2", 1.05, 520), terms("1-2", 0.5, 1024), terms("3", 2.0, 1024)]
    assert resizes(target(), wanted, running) == {
        "1": {"requests": {"cpu": "50m", "memory": "160Mi"}, "limits": {"cpu": "2", "memory": "1024Mi"}},
        "1-2": {"requests": {"cpu": "50m", "memory": "160Mi"}, "limits": {"cpu": "1", "memory": "1024Mi"}},
    }


def test_limits_that_the_fleet_spec_gives_are_kept() -> None:
    fixed = target(aggregation={"resources": {"limits": {"cpu": "1", "memory": "512Mi"}}})
    has = aggregator_resources(fixed, terms("1", 0.5, 256))
    assert resizes(fixed, [terms("1", 4.0, 4096)], {"1": has}) == {}

"""Parts of the test bed that need neither root nor its programs."""

from __future__ import annotations

import json
import socket
import tarfile
from pathlib import Path

import pytest

from tests.testbed.audit import Request, read_audit_log
from tests.testbed.configuration import faces
from tests.testbed.errors import NotReady
from tests.testbed.fixtures import elsewhere
from tests.testbed.image_store import images_of
from tests.testbed.machine import INIT
from tests.testbed.ports import Ports
from tests.testbed.power import magic_packet
from tests.testbed.processes import Program
from tests.testbed.recipes import ON_REQUEST, RECIPES, recipe_of
from tests.testbed.requirements import refuse
from tests.testbed.site import CLUSTER, GIB, TESTS, BedSpec, Size, machines
from tests.testbed.small_images import _write
from tests.testbed.volumes import NODE, volume_of
from tests.testbed.waiting import wait_for


def test_two_users_never_get_the_same_port_and_one_that_is_listened_on_is_left_out() -> None:
    first, second = Ports(seed=7), Ports(seed=7)  # both look at the same ports in the same order
    with socket.socket() as busy:
        taken = Ports(seed=7)
        port = taken.take()
        taken.close()
        busy.bind(("127.0.0.1", port))
        busy.listen()
        given = [first.take() for _ in range(20)] + [second.take() for _ in range(20)]
    first.close()
    second.close()
    assert len(set(given)) == 40
    assert port not in given


def test_a_magic_packet_is_six_bytes_of_ones_and_sixteen_times_the_address() -> None:
    packet = magic_packet("02:f1:ee:4d:00:03")
    assert packet == b"\xff\xff\xff\xff\xff\xff" + b"\x02\xf1\xee\x4d\x00\x03" * 16


def test_sites_share_no_name_and_no_address() -> None:
    sites = [CLUSTER, *TESTS]
    addresses = [(site.hub.rsplit(".", 2)[0], site.pods, site.services) for site in sites]
    flat = [".".join(one.split(".")[:2]) for group in addresses for one in group]
    assert len(set(flat)) == 3 * len(sites)
    assert len({site.prefix for site in sites}) == len(sites)
    assert all(len(f"{site.cable}") <= 15 for site in sites)  # the longest name of an interface


def test_a_small_machine_keeps_its_cores_from_pods_and_shows_its_memory() -> None:
    (hub,) = machines(edges=0, size=Size(cores=0.25, memory_bytes=GIB))
    shown = faces(hub, "id", "boot", "hosts")["proc/meminfo"].splitlines()
    assert "MemTotal: 1048576 kB" in shown
    assert hub.size.reserved_cores > 0
    assert Size(cores=10_000).reserved_cores == 0
    assert [one.name for one in BedSpec().machines] == ["hub", "edge1", "edge2", "edge3"]


def test_each_program_has_one_recipe_and_only_kwok_waits_to_be_asked_for() -> None:
    programs = [name for recipe in RECIPES.values() for name in recipe.commands]
    assert len(set(programs)) == len(programs)
    assert recipe_of("kubelet").name == "kubernetes"
    assert set(RECIPES) - ON_REQUEST == {"kubernetes", "etcd", "containerd", "coredns", "helm"}
    assert len({recipe.key for recipe in RECIPES.values()}) == len(RECIPES)


def test_a_test_that_cannot_run_is_skipped_and_fails_where_it_must_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FLEET_TESTBED", raising=False)
    with pytest.raises(pytest.skip.Exception, match="do this"):
        refuse("do this")
    monkeypatch.setenv("FLEET_TESTBED", "required")
    with pytest.raises(pytest.fail.Exception, match="do this"):
        refuse("do this")


def test_the_audit_log_has_each_request_once_and_a_watch_too(tmp_path: Path) -> None:
    about = {"resource": "jobs", "subresource": "status", "namespace": "n", "name": "j", "apiGroup": "batch"}
    event = {"auditID": "1", "user": {"username": "anna"}, "verb": "patch", "requestURI": "/u", "objectRef": about}
    watch = {"auditID": "2", "user": {"username": "anna"}, "verb": "watch", "requestURI": "/w"}
    events = [event | {"responseStatus": {"code": 200}}, watch | {"stage": "ResponseStarted"}, watch]
    log = tmp_path / "audit.log"
    log.write_text("".join(json.dumps(one) + "\n" for one in events))
    assert read_audit_log(log) == [
        Request("anna", "patch", "batch", "jobs/status", "n", "j", 200, "/u"),
        Request("anna", "watch", "", "", "", "", 0, "/w"),
    ]


def test_a_volume_is_on_the_node_of_the_pod_and_bound_to_its_claim() -> None:
    meta = {"namespace": "n", "name": "c", "uid": "u-1", "annotations": {NODE: "edge2"}}
    spec = {"accessModes": ["ReadWriteOnce"], "resources": {"requests": {"storage": "1Gi"}}}
    volume = volume_of({"metadata": meta, "spec": spec})
    assert volume["metadata"]["name"] == "pvc-u-1"
    assert volume["spec"]["local"] == {"path": "/var/lib/fleet-volumes/pvc-u-1"}
    assert volume["spec"]["claimRef"]["uid"] == "u-1"
    (terms,) = volume["spec"]["nodeAffinity"]["required"]["nodeSelectorTerms"]
    assert terms["matchExpressions"][0]["values"] == ["edge2"]


def test_an_image_archive_says_the_name_of_its_image(tmp_path: Path) -> None:
    archive = tmp_path / "one.tar"
    _write(archive, "fleet.test/one:1", ["/bin/true"], b"layer")
    (name,) = images_of(archive)
    assert name == "fleet.test/one:1"
    with tarfile.open(archive) as opened:
        assert "oci-layout" in opened.getnames()


def test_a_program_that_ends_before_it_is_ready_says_why(tmp_path: Path) -> None:
    program = Program(["sh", "-c", "echo no such thing; exit 3"], tmp_path / "log")
    program.start()
    with pytest.raises(NotReady, match="no such thing"):
        program.wait_ready(lambda: False)
    program.stop()


def test_waiting_ends_with_what_is_found_or_with_what_was_waited_for() -> None:
    found = iter([None, False, "it"])
    assert wait_for("it", lambda: next(found), every_s=0.0) == "it"
    with pytest.raises(NotReady, match="the end of days: not within 0 s"):
        wait_for("the end of days", lambda: None, timeout_s=0.0)


def test_the_first_process_of_a_machine_is_a_program() -> None:
    assert INIT.stat().st_mode & 0o111


@pytest.mark.xdist_group("grouped")
def test_tests_of_a_group_are_sent_to_one_worker(request: pytest.FixtureRequest) -> None:
    if not request.config.getoption("loadgroup", default=False):
        pytest.skip("only with pytest -n N --dist loadgroup")
    # pytest-xdist 3.8 groups by this suffix, and pytest 9.2 does not let it be added: each worker would have machines.
    assert request.node.nodeid.endswith("@grouped")


def test_a_cluster_that_is_not_ours_is_used_only_when_that_is_said(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    kubeconfig = tmp_path / "config"
    kubeconfig.touch()
    monkeypatch.setenv("KUBECONFIG", str(kubeconfig))
    monkeypatch.delenv("FLEET_TEST_CLUSTER", raising=False)
    assert elsewhere() is None
    monkeypatch.setenv("FLEET_TEST_CLUSTER", "kubeconfig")
    assert elsewhere() == kubeconfig
    kubeconfig.unlink()
    with pytest.raises(pytest.fail.Exception, match="set KUBECONFIG"):
        elsewhere()

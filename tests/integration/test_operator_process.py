"""The operator as a process: it is ready, stops in good order, and exactly one replica is at work."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from fleet.errors import ExitCode
from tests.conftest import ROOT
from tests.connected import make_namespace
from tests.spec_documents import fleet_document
from tests.testbed.control_plane import ControlPlane
from tests.testbed.ports import Ports
from tests.testbed.waiting import wait_for

pytestmark = pytest.mark.xdist_group("control-plane")
NAMESPACE = "operator-process"


@pytest.fixture(scope="module")
def plane(control_plane: ControlPlane) -> Iterator[ControlPlane]:
    make_namespace(control_plane, NAMESPACE)
    yield control_plane
    control_plane.kubectl("delete", "namespace", NAMESPACE, "--wait=false")


class Operator:
    """One replica."""

    def __init__(self, plane: ControlPlane, folder: Path, identity: str, lease: str, **environment: str) -> None:
        self.identity = identity
        self._ports = Ports()
        self._log = folder / f"{identity}.log"
        self.port = self._ports.take()
        settings = {
            "NAMESPACE": NAMESPACE,
            "WATCH_NAMESPACES": NAMESPACE,
            "HEALTH_PORT": str(self.port),
            "IDENTITY": identity,
            "LEASE": lease,
            "LEASE_SECONDS": "4",
        }
        variables = {f"FLEET_OPERATOR_{name}": text for name, text in settings.items()} | environment
        paths = os.pathsep.join([str(ROOT), str(ROOT / "operator")])
        with self._log.open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "tests.stand_in_operator"],
                cwd=ROOT,
                env=os.environ | variables | {"KUBECONFIG": str(plane.kubeconfig), "PYTHONPATH": paths},
                stdout=log,
                stderr=subprocess.STDOUT,
            )

    def page(self, path: str) -> tuple[int, str]:
        """Status and text; (0, "") when nobody answers."""
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        try:
            with opener.open(f"http://127.0.0.1:{self.port}{path}", timeout=10) as answer:
                return int(answer.status), answer.read().decode()
        except urllib.error.HTTPError as error:
            with error:
                return int(error.code), error.read().decode()
        except OSError:
            return 0, ""

    def wait_until(self, state: str) -> None:
        wait_for(f"{self.identity} {state}", lambda: self.page("/readyz") == (200, f"{state}\n"))

    @property
    def log(self) -> str:
        return self._log.read_text()

    def signal(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def end(self) -> int:
        """Its exit code."""
        return self.process.wait(60)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self._ports.close()


Start = Callable[..., Operator]


@pytest.fixture
def start(plane: ControlPlane, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Start]:
    """Starts replicas that share a lease of this test; they end with it."""
    running: list[Operator] = []

    def begin(identity: str, **environment: str) -> Operator:
        lease = request.node.name.replace("_", "-")[:60]
        running.append(Operator(plane, tmp_path, identity, lease, **environment))
        return running[-1]

    yield begin
    for operator in running:
        operator.close()


def make_fleet(plane: ControlPlane, name: str) -> None:
    document = fleet_document()
    document["metadata"] = {"name": name, "namespace": NAMESPACE}
    plane.apply(document)


def seen(plane: ControlPlane, name: str) -> dict[str, Any]:
    """What the operator noted of a fleet, as soon as it has."""

    def look() -> dict[str, Any] | None:
        found = plane.try_kubectl("get", "configmap", f"{name}-seen", "-n", NAMESPACE, "-o", "jsonpath={.data}")
        return None if found.returncode else dict(plane.get("configmap", f"{name}-seen", "-n", NAMESPACE)["data"])

    return wait_for(f"{name} is seen", look)


def lease_of(plane: ControlPlane, request: pytest.FixtureRequest) -> dict[str, Any]:
    name = request.node.name.replace("_", "-")[:60]
    return dict(plane.get("lease", name, "-n", NAMESPACE)["spec"])


def test_an_operator_becomes_ready_works_and_gives_its_lease_back(
    plane: ControlPlane, start: Start, request: pytest.FixtureRequest
) -> None:
    one = start("one")
    one.wait_until("at work")
    assert one.page("/healthz") == (200, "ok\n")
    make_fleet(plane, "first")
    assert seen(plane, "first") == {"by": "one", "generation": "1"}
    assert plane.get("fleet", "first", "-n", NAMESPACE)["status"]["phase"] == "Seen"
    numbers = one.page("/metrics")[1].splitlines()
    assert {'fleet_operator_api_calls_total{code="201",verb="patch"} 1', "fleet_operator_leading 1"} <= {*numbers}

    plane.kubectl("-n", NAMESPACE, "delete", "fleet", "first")
    wait_for("the fleet is forgotten", lambda: "forget first of generation 1" in one.log)
    one.signal(signal.SIGTERM)
    assert one.end() == ExitCode.OK
    assert lease_of(plane, request)["holderIdentity"] == ""
    assert "Traceback" not in one.log


def test_sigterm_lets_the_pass_at_work_end_and_the_other_replica_go_on(
    plane: ControlPlane, start: Start, request: pytest.FixtureRequest
) -> None:
    first = start("first", STAND_IN_PASS_S="2")
    first.wait_until("at work")
    second = start("second")
    second.wait_until("ready to take over")
    make_fleet(plane, "handed")
    wait_for("the pass is at work", lambda: "pass of handed" in first.log)
    first.signal(signal.SIGTERM)
    assert first.end() == ExitCode.OK
    assert "saw handed" in first.log
    second.wait_until("at work")
    make_fleet(plane, "after")
    assert seen(plane, "after")["by"] == "second"
    assert (lease_of(plane, request)["holderIdentity"], lease_of(plane, request)["leaseTransitions"]) == ("second", 0)


def test_after_a_kill_the_other_replica_takes_over_when_the_lease_is_over(
    plane: ControlPlane, start: Start, request: pytest.FixtureRequest
) -> None:
    first = start("first")
    first.wait_until("at work")
    second = start("second")
    second.wait_until("ready to take over")
    make_fleet(plane, "left")
    seen(plane, "left")
    first.signal(signal.SIGKILL)
    plane.kubectl("-n", NAMESPACE, "delete", "fleet", "left")  # nobody is there to forget it but the sweep
    make_fleet(plane, "taken")
    second.wait_until("at work")
    assert seen(plane, "taken")["by"] == "second"
    assert (lease_of(plane, request)["holderIdentity"], lease_of(plane, request)["leaseTransitions"]) == ("second", 1)
    assert "sweep beside" in second.log
    assert "left" not in second.log


def test_a_replica_that_loses_its_lease_stops_writing_and_ends(
    plane: ControlPlane, start: Start, request: pytest.FixtureRequest
) -> None:
    one = start("one", STAND_IN_PASS_S="3600")
    one.wait_until("at work")
    make_fleet(plane, "never")
    wait_for("the pass is at work", lambda: "pass of never" in one.log)
    name = request.node.name.replace("_", "-")[:60]
    plane.kubectl("-n", NAMESPACE, "patch", "lease", name, "--type=merge", "-p", '{"spec":{"holderIdentity":"other"}}')
    assert one.end() == ExitCode.TRANSIENT
    assert "the lease is lost" in one.log
    assert lease_of(plane, request)["holderIdentity"] == "other"


def test_without_an_api_server_the_operator_is_alive_but_not_ready_and_recovers(
    plane: ControlPlane, start: Start
) -> None:
    one = start("one")
    one.wait_until("at work")
    plane.stop_api_server()
    try:
        wait_for("the operator misses the API server", lambda: one.page("/readyz")[0] != 200)
        assert one.page("/healthz") == (200, "ok\n") or one.end() == ExitCode.TRANSIENT
    finally:
        plane.start_api_server()
    # Whoever cannot renew its lease must not go on: it ends, and is started again.
    assert one.end() == ExitCode.TRANSIENT
    again = start("one")
    again.wait_until("at work")


def test_a_wrong_configuration_is_said_and_ends_at_once(start: Start) -> None:
    bad = start("bad", FLEET_OPERATOR_WORKERS="many")
    assert bad.end() == ExitCode.USAGE
    assert bad.log == ('fleet-operator: FLEET_OPERATOR_WORKERS is "many"; it must be a whole number from 1 to 256\n')

"""A bed as its users see it: a cluster of several machines with power buttons."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from http import HTTPStatus
from pathlib import Path
from typing import Any, BinaryIO

from tests.testbed.access import Access
from tests.testbed.api import Api
from tests.testbed.binaries import cache, tool
from tests.testbed.errors import BedError, CommandFailed, NotReady
from tests.testbed.image_store import image_store, images_of
from tests.testbed.keeper import SPEC
from tests.testbed.power import send_magic_packet
from tests.testbed.processes import LOG_TAIL
from tests.testbed.records import MARK, SiteLock, clear_up, read_record, socket_path
from tests.testbed.site import TESTS, BedSpec, Site
from tests.testbed.small_images import small_images
from tests.testbed.waiting import wait_for

ROOT = Path(__file__).resolve().parents[2]
MACHINE_PATH = "/run/programs:/usr/sbin:/usr/bin:/sbin:/bin"
# What runs in machines, and what a test runs there.
PROGRAMS = (
    "etcd", "kube-apiserver", "kube-controller-manager", "kube-scheduler", "coredns", "kubelet", "kube-proxy",
    "containerd", "containerd-shim-runc-v2", "ctr",
)  # fmt: skip
NOT_READY = "node.kubernetes.io/"  # taints that the cluster itself sets
START_S = 60.0  # machines need a few seconds; this is for a computer that is busy


class MachineHandle:
    """One machine of a bed."""

    def __init__(self, bed: Bed, name: str) -> None:
        self._bed = bed
        self.name = name
        index = bed.spec.index(name)
        self.spec = bed.spec.machines[index]
        self.address = bed.spec.site.address(index)
        self.mac = bed.spec.site.mac(index)

    @property
    def on(self) -> bool:
        """Whether its power is on."""
        return bool(self._bed.order("status")["machines"][self.name])

    def power_on(self) -> None:
        """Press the power button of a machine that is off."""
        self._bed.order("power-on", self.name)

    def power_off(self) -> None:
        """Cut the power: every process is dead when this returns; the disk stays."""
        self._bed.order("power-off", self.name)

    def wake(self) -> None:
        """Send the machine's Wake-on-LAN packet; it starts if it is off."""
        send_magic_packet(self.mac, self._bed.spec.site.broadcast)

    @property
    def ready(self) -> bool:
        """Whether the API server says that the node is Ready."""
        return self._bed.readiness().get(self.name, False)

    def run(self, *command: str, stdin: BinaryIO | None = None, timeout_s: float = 300.0) -> str:
        """What a command prints that is run in the machine, as root, beside its pods."""
        outside = (self._bed.folder / self.name / "pid").read_text()
        first = Path(f"/proc/{outside}/task/{outside}/children").read_text().split()[0]
        enter = ["nsenter", f"--target={first}", "--all", "env", f"PATH={MACHINE_PATH}", *command]
        done = subprocess.run(enter, stdin=stdin, text=True, capture_output=True, timeout=timeout_s, check=False)
        if done.returncode:
            raise CommandFailed(enter, done.returncode, done.stdout, done.stderr)
        return done.stdout

    def load_image(self, archive: Path) -> None:
        """Bring the images of an OCI archive into the machine, unless it has them."""
        listed = [line.split() for line in self.run("ctr", "--namespace", "k8s.io", "images", "ls").splitlines()]
        present = {columns[0]: columns[2] for columns in listed}
        if images_of(archive).items() <= present.items():
            return
        with archive.open("rb") as file:
            self.run("ctr", "--namespace", "k8s.io", "images", "import", "-", stdin=file)


class Bed(Access):
    """A cluster of machines of our own."""

    def __init__(self, spec: BedSpec, folder: Path) -> None:
        super().__init__(folder / "admin.kubeconfig")
        self.spec = spec
        self.folder = folder
        self.keeper: subprocess.Popen[bytes] | None = None  # when this process started it
        self.machines = tuple(MachineHandle(self, machine.name) for machine in spec.machines)

    def machine(self, name: str) -> MachineHandle:
        """The machine of this name: hub, edge1, edge2, edge3."""
        return self.machines[self.spec.index(name)]

    def load_image(self, archive: Path) -> None:
        """Bring the images of an OCI archive into every machine; faster is to give them to `bed` at the start."""
        for machine in self.machines:
            machine.load_image(archive)

    def readiness(self) -> dict[str, bool]:
        """Whether each node that the API server knows is Ready and takes pods."""
        try:
            status, nodes = self._api().call("GET", "/api/v1/nodes")
        except OSError:  # the hub is off, or boots
            return {}
        if status != HTTPStatus.OK:
            return {}
        return {node["metadata"]["name"]: _is_ready(node) for node in nodes["items"]}

    def wait_ready(self, timeout_s: float = START_S) -> None:
        """Wait until every machine is a Ready node that takes pods."""
        names = {machine.name for machine in self.machines}

        def look() -> bool:
            # A namespace's service account comes a moment later; no pod can be made without it.
            ready = {name for name, is_ready in self.readiness().items() if is_ready}
            return ready >= names and self._api().has("/api/v1/namespaces/default/serviceaccounts/default")

        wait_for("all nodes Ready", look, timeout_s, every_s=0.2)

    def _api(self) -> Api:
        """The API server without kubectl, which waits half a minute for a hub that is off."""
        content = json.loads(self.kubeconfig.read_text())
        cluster, user = content["clusters"][0]["cluster"], content["users"][0]["user"]
        return Api(cluster["server"], Path(cluster["certificate-authority"]), user["token"])

    def order(self, do: str, machine: str = "") -> dict[str, Any]:
        """Give an order to the keeper of the bed.

        Raises:
            BedError: there is no keeper, or it could not do it.
        """
        path = socket_path(self.spec.site)
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            try:
                connection.connect(str(path))
            except OSError as error:
                raise BedError(f"no bed runs at {path}: {error}") from error
            with connection.makefile("rw") as stream:
                stream.write(json.dumps({"do": do, "machine": machine}) + "\n")
                stream.flush()
                answer: dict[str, Any] = json.loads(stream.readline() or '{"error": "the keeper died"}')
        if "error" in answer:
            raise BedError(answer["error"])
        return answer

    def down(self) -> None:
        """Switch everything off and remove every trace but logs and configuration."""
        self.order("down")
        if self.keeper is not None:
            self.keeper.wait()
        lock = SiteLock(self.spec.site)
        wait_for("the end of the keeper", lock.try_take, timeout_s=20.0)
        lock.close()


def start_bed(folder: Path, sites: Sequence[Site], images: Sequence[Path] = (), spec: BedSpec | None = None) -> Bed:
    """Start a bed that lives until `Bed.down`, also after this process.

    Args:
        folder: Keys, configuration, logs and disks of the machines; made if missing.
        sites: Names and addresses; the first that no other bed has is taken.
        images: OCI archives whose images all machines have, besides the small ones.
        spec: Machines and timing; its site is replaced.
    Raises:
        BedError: all sites are taken, or the bed does not start.
    """
    return _start(folder, sites, images, spec, ())


@contextmanager
def bed(
    folder: Path, images: Sequence[Path] = (), spec: BedSpec | None = None, sites: Sequence[Site] = TESTS
) -> Iterator[Bed]:
    """A bed of the tests: it ends with the context, and when this process is killed.

    Start it in the main thread: the kernel ends it with the thread that started it. For arguments see `start_bed`.
    """
    started = _start(folder, sites, images, spec, ("setpriv", "--pdeathsig", "KILL"))
    try:
        started.wait_ready()
        yield started
    finally:
        started.down()


def _start(
    folder: Path, sites: Sequence[Site], images: Sequence[Path], spec: BedSpec | None, wrapper: Sequence[str]
) -> Bed:
    programs = [str(tool(name)) for name in PROGRAMS]
    store = image_store([*small_images(cache() / "small-images"), *images])
    lock = _free_site(sites)
    started = Bed(replace(spec or BedSpec(), site=lock.site), folder.resolve())
    folder = started.folder
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MARK).touch()
    (folder / "spec.json").write_bytes(SPEC.dump_json(started.spec, indent=1))
    command = [sys.executable, "-m", "tests.testbed.keeper", str(folder), str(store.folder), *programs]
    with store.held(), lock, (folder / "keeper.log").open("ab") as log:
        started.keeper = subprocess.Popen(
            [*wrapper, *command],
            cwd=ROOT,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            pass_fds=[lock.fileno()],
        )
        _await_keeper(started, started.keeper)
    return started


def _free_site(sites: Sequence[Site]) -> SiteLock:
    """The lock of the first site that nobody has; what killed beds have left at the others is removed."""
    chosen: SiteLock | None = None
    for site in sites:
        lock = SiteLock(site)
        if not lock.try_take():
            lock.close()
        elif chosen is None:
            chosen = lock  # the keeper clears up there
        else:
            clear_up(site)
            lock.close()
    if chosen is None:
        taken = ", ".join(f"{site.prefix} ({record.folder})" for site in sites if (record := read_record(site)))
        raise BedError(f"every site has a bed already: {taken}")
    return chosen


def _await_keeper(started: Bed, process: subprocess.Popen[bytes]) -> None:
    def look() -> bool:
        if process.poll() is not None:
            log = (started.folder / "keeper.log").read_text()[-LOG_TAIL:]
            raise NotReady(f"the bed did not start: {log}")
        try:
            started.order("status")
        except BedError:
            return False
        return True

    try:
        wait_for("the keeper of the bed", look, START_S)
    except BaseException:  # an interrupt as well: the keeper would go on alone
        process.terminate()
        process.wait()
        raise


def _is_ready(node: dict[str, Any]) -> bool:
    conditions = node["status"].get("conditions", ())
    ready = any(one["type"] == "Ready" and one["status"] == "True" for one in conditions)
    return ready and not any(taint["key"].startswith(NOT_READY) for taint in node["spec"].get("taints", ()))

"""The cluster of one machine, with small real programs in manifests."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from fleet_operator.local.addresses import Addresses
from fleet_operator.local.events import ContainerDied, Event, JobFailed, JobSucceeded, PodStarted
from fleet_operator.local.machine import Capacity, JobState, Machine
from fleet_operator.local.workloads import UnsupportedManifest
from tests.manifest_builders import SERVER, classes, container, job, service, sidecar

ENDED = {JobState.SUCCEEDED, JobState.FAILED}
ASK = "import os, urllib.request as u; print(u.urlopen(os.environ['URL'], timeout=5).read().decode())"
PATIENCE_S = 30.0


class Bed:
    """A machine and everything that it said."""

    def __init__(self, folder: Path, cores: int = 4) -> None:
        self.folder = folder
        self.events: list[Event] = []
        self.machine = Machine(folder, Capacity(cores, 2.0**33), self.events.append, Addresses(os.getpid()))
        self.machine.apply(classes())

    def until(self, reached: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        self.machine.run_while(lambda: not reached() and time.monotonic() < deadline_s)
        assert reached(), self.events

    def until_ended(self, *names: str) -> list[JobState | None]:
        self.until(lambda: all(self.machine.state(name) in ENDED for name in names))
        return [self.machine.state(name) for name in names]

    def log(self, name: str, container_name: str = "main") -> str:
        return (self.folder / "logs" / name / f"{container_name}.log").read_text()

    def kinds(self, name: str) -> list[type]:
        return [type(event) for event in self.events if event.subject.job == name]


@pytest.fixture
def bed(tmp_path: Path) -> Iterator[Bed]:
    bed = Bed(tmp_path)
    yield bed
    bed.machine.close()


def test_a_job_runs_its_command_with_its_environment_and_ends(bed: Bed) -> None:
    script = "import os; print(os.environ['WORD'], os.environ.get('USER', 'nobody'), os.getcwd() == os.environ['HOME'])"
    bed.machine.apply([job("one", container("main", script, WORD="hello", HOME="/tmp"))])
    assert bed.until_ended("one") == [JobState.SUCCEEDED]
    assert bed.log("one") == "hello nobody True\n"
    assert bed.kinds("one") == [PodStarted, JobSucceeded]
    assert list((bed.folder / "volumes" / "pods").iterdir()) == []


def test_sidecars_answer_before_the_main_container_starts_and_end_with_it(bed: Bed) -> None:
    slow = "import time; time.sleep(0.5)\n" + SERVER
    bed.machine.apply(
        [
            job(
                "flight",
                container("main", ASK, URL="http://localhost:8082/x"),
                sidecar("map", slow),
                sidecar("eval", port=8082, ANSWER="evaluated"),
            )
        ]
    )
    assert bed.until_ended("flight") == [JobState.SUCCEEDED]
    assert bed.log("flight") == "evaluated\n"
    assert not processes_with(str(bed.folder))


def test_a_service_name_leads_to_the_pod_behind_it(bed: Bed) -> None:
    bed.machine.apply(
        [
            service("vehicle", part="sensor"),
            job("sensor", container("main", SERVER, 8080, ANSWER="sensed"), level=10, part="sensor"),
            job(
                "flight", container("main", f"import time; time.sleep(0.5)\n{ASK}", URL="http://vehicle.default:8080/")
            ),
        ]
    )
    assert bed.until_ended("flight") == [JobState.SUCCEEDED]
    assert bed.log("flight") == "sensed\n"
    assert bed.machine.state("sensor") is JobState.RUNNING


def test_a_failing_program_is_tried_again_up_to_the_limit(bed: Bed) -> None:
    bed.machine.apply([job("flaky", container("main", "print('no luck'); raise SystemExit(3)"), backoff_limit=2)])
    assert bed.until_ended("flaky") == [JobState.FAILED]
    assert bed.kinds("flaky") == [PodStarted, ContainerDied] * 2 + [PodStarted, JobFailed]
    assert bed.log("flaky") == "no luck\n" * 3
    assert bed.machine.message("flaky").startswith(
        "flaky failed after 3 tries: main ended with exit code 3; the end of"
    )
    assert bed.machine.message("flaky").endswith("no luck")


def test_a_program_that_succeeds_at_the_second_try_has_succeeded(bed: Bed) -> None:
    marker = bed.folder / "marker"
    script = (
        f"import pathlib, sys; m = pathlib.Path({str(marker)!r}); e = m.exists(); m.touch(); sys.exit(0 if e else 75)"
    )
    bed.machine.apply([job("flaky", container("main", script))])
    assert bed.until_ended("flaky") == [JobState.SUCCEEDED]


def test_exit_code_65_fails_the_job_at_once(bed: Bed) -> None:
    bed.machine.apply([job("broken", container("main", "raise SystemExit(65)"), backoff_limit=20)])
    assert bed.until_ended("broken") == [JobState.FAILED]
    assert bed.kinds("broken") == [PodStarted, JobFailed]
    assert bed.machine.message("broken").startswith("broken failed: main ended with exit code 65; it wrote nothing to ")


def test_a_killed_main_container_is_started_again(bed: Bed) -> None:
    marker = bed.folder / "pid"
    script = (
        "import os, pathlib, sys, time\n"
        f"m = pathlib.Path({str(marker)!r})\n"
        "if m.exists(): sys.exit(0)\n"
        "m.write_text(str(os.getpid())); time.sleep(60)"
    )
    bed.machine.apply([job("flight", container("main", script))])
    bed.until(lambda: marker.exists() and bool(marker.read_text()))
    os.kill(int(marker.read_text()), signal.SIGKILL)
    assert bed.until_ended("flight") == [JobState.SUCCEEDED]
    [died] = [event for event in bed.events if isinstance(event, ContainerDied)]
    assert died.reason.startswith("main ended with exit code 137 (killed); it wrote nothing to ")


def test_a_sidecar_that_dies_is_started_again_at_the_same_address_and_the_flight_goes_on(bed: Bed) -> None:
    ask_until_two = """
import os, time, urllib.request as u
seen = set()
while len(seen) < 2:
    try:
        seen.add(u.urlopen(os.environ["URL"], timeout=5).read())
        open("ASKED", "w").close()
    except OSError:
        pass
    time.sleep(0.02)
"""
    asked = bed.folder / "asked"
    ask = ask_until_two.replace("ASKED", str(asked))
    server = SERVER.replace('os.environ.get("ANSWER", "ok")', "str(os.getpid())")
    main = container("main", ask, URL="http://localhost:8081/")
    bed.machine.apply([job("flight", main, sidecar("map", server))])
    pod_of = bed.machine._entries["flight"]  # the test kills a process that only the machine knows
    bed.until(asked.exists)
    assert pod_of.pod is not None
    victim = next(process.pid for each, process in pod_of.pod.running if each.name == "map")
    os.kill(victim, signal.SIGKILL)
    assert bed.until_ended("flight") == [JobState.SUCCEEDED]
    [died] = [event for event in bed.events if isinstance(event, ContainerDied)]
    assert died.container == "map"
    assert died.reason.startswith("map ended with exit code 137 (killed); it wrote nothing to ")


def test_a_sidecar_that_can_never_start_fails_the_job_with_its_log(bed: Bed) -> None:
    broken = sidecar("map", "print('no module own'); raise SystemExit(65)")
    bed.machine.apply([job("flight", container("main", "pass"), broken, backoff_limit=20)])
    assert bed.until_ended("flight") == [JobState.FAILED]
    assert "map ended with exit code 65" in bed.machine.message("flight")
    assert bed.machine.message("flight").endswith("no module own")


def test_a_container_over_its_memory_limit_is_killed_and_it_is_said_which_limit(bed: Bed) -> None:
    hungry = "import time; data = bytearray(600 * 2**20); time.sleep(60)"
    bed.machine.apply([job("hungry", container("main", hungry), backoff_limit=0)])
    assert bed.until_ended("hungry") == [JobState.FAILED]
    message = bed.machine.message("hungry")
    assert "MiB of memory, and its limit is 256 MiB; raise the limit of main in the FleetSpec" in message
    assert bed.machine.meter.peak_bytes > 10 * 2**20


def test_workers_of_a_container_count_for_its_memory_and_end_with_it(bed: Bed) -> None:
    parent = (
        "import subprocess, sys, time\n"
        "child = [sys.executable, '-c', 'import time; d = bytearray(200 * 2**20); time.sleep(60)']\n"
        "workers = [subprocess.Popen(child) for _ in range(2)]\n"
        "time.sleep(60)"
    )
    bed.machine.apply([job("workers", container("main", parent), backoff_limit=0)])
    assert bed.until_ended("workers") == [JobState.FAILED]
    assert not processes_with("d = bytearray(200 * 2**20)")


def test_suspended_jobs_do_not_run_and_the_highest_level_goes_first(tmp_path: Path) -> None:
    bed = Bed(tmp_path, cores=1)
    try:
        names = ["low", "high", "middle", "first", "never"]
        levels = [1, 9, 5, 9, 0]
        script = f"import os; open({str(tmp_path / 'order')!r}, 'a').write(os.environ['NAME'] + ' ')"
        jobs = [
            job(name, container("main", script, NAME=name), level=level)
            for name, level in zip(names, levels, strict=True)
        ]
        bed.machine.apply(jobs)
        bed.until_ended(*names[:4])
        assert (tmp_path / "order").read_text() == "high first middle low "
        assert bed.machine.state("never") is JobState.SUSPENDED
    finally:
        bed.machine.close()


def test_the_real_time_level_does_not_wait_for_room(tmp_path: Path) -> None:
    bed = Bed(tmp_path, cores=1)
    try:
        wait = "import time; time.sleep(60)"
        bed.machine.apply([job("busy", container("main", wait)), job("queued", container("main", wait))])
        bed.machine.apply([job("sensor", container("main", "pass"), level=10)])
        assert bed.until_ended("sensor") == [JobState.SUCCEEDED]
        assert (bed.machine.state("busy"), bed.machine.state("queued")) == (JobState.RUNNING, JobState.PENDING)
    finally:
        bed.machine.close()


def test_applying_twice_changes_nothing_and_deleting_stops(bed: Bed) -> None:
    manifest = job("long", container("main", "import time; time.sleep(60)"))
    bed.machine.apply([manifest])
    bed.until(lambda: bed.machine.state("long") is JobState.RUNNING)
    bed.machine.apply([manifest])
    assert bed.kinds("long") == [PodStarted]
    bed.machine.delete(["long"])
    assert bed.machine.state("long") is None
    bed.until(lambda: not processes_with(str(bed.folder)))


def test_a_program_that_ignores_sigterm_is_killed_when_the_machine_closes(tmp_path: Path) -> None:
    bed = Bed(tmp_path)
    marker = tmp_path / "ready"
    stubborn = (
        "import pathlib, signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        f"pathlib.Path({str(marker)!r}).touch(); time.sleep(60)"
    )
    bed.machine.apply([job("stubborn", container("main", stubborn))])
    bed.until(marker.exists)
    bed.machine.close()
    assert not processes_with(str(marker))


def test_config_maps_are_files_below_their_mount(bed: Bed) -> None:
    config = {
        "apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": "sources"},
        "data": {"pkg.own.py": "value = 42\n"}, "binaryData": {"model.npz": "/wA="},
    }  # fmt: skip
    script = (
        "import json, pathlib; from pkg import own\n"
        "print(json.dumps([own.value, len(pathlib.Path('model.npz').read_bytes())]))"
    )
    main = container("main", script, PYTHONPATH="/fleet/functions")
    main["workingDir"] = "/fleet/functions"
    main["volumeMounts"].append({"name": "functions", "mountPath": "/fleet/functions"})
    manifest = job("reader", main)
    items = [{"key": "pkg.own.py", "path": "pkg/own.py"}, {"key": "model.npz", "path": "model.npz"}]
    manifest["spec"]["template"]["spec"]["volumes"].append(
        {"name": "functions", "configMap": {"name": "sources", "items": items}}
    )
    bed.machine.apply([config, manifest])
    assert bed.until_ended("reader") == [JobState.SUCCEEDED]
    assert json.loads(bed.log("reader")) == [42, 2]


def test_what_the_machine_does_not_have_is_refused(bed: Bed) -> None:
    host_path = job("mounts", container("main", "pass"))
    host_path["spec"]["template"]["spec"]["volumes"].append({"name": "disk", "hostPath": {"path": "/"}})
    with pytest.raises(UnsupportedManifest, match="volume disk is neither an emptyDir nor a ConfigMap"):
        bed.machine.apply([host_path])
    with pytest.raises(UnsupportedManifest, match="does not know this kind of object"):
        bed.machine.apply([{"kind": "Deployment", "metadata": {"name": "x"}}])
    image_only = container("main", "pass")
    del image_only["command"]
    with pytest.raises(UnsupportedManifest, match="cannot be run on this machine without a container runtime"):
        bed.machine.apply([job("image", image_only)])


def test_two_machines_at_once_do_not_share_addresses(tmp_path: Path) -> None:
    beds = [Bed(tmp_path / name) for name in ("one", "two")]
    try:
        for bed, answer in zip(beds, ("first", "second"), strict=True):
            bed.machine.apply(
                [job("flight", container("main", ASK, URL="http://localhost:8081/"), sidecar("map", ANSWER=answer))]
            )
        deadline_s = time.monotonic() + PATIENCE_S
        while any(bed.machine.state("flight") not in ENDED for bed in beds) and time.monotonic() < deadline_s:
            for bed in beds:
                bed.machine.step()
            time.sleep(0.01)
        assert [bed.log("flight") for bed in beds] == ["first\n", "second\n"]
    finally:
        for bed in beds:
            bed.machine.close()


def processes_with(text: str) -> list[int]:
    """Processes whose command line or working folder has a text."""
    found = []
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit() or int(folder.name) == os.getpid():
            continue
        try:
            line = (folder / "cmdline").read_bytes().decode(errors="replace")
            if text in line or text in str((folder / "cwd").readlink()):
                found.append(int(folder.name))
        except OSError:
            continue
    return found

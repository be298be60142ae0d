"""A bed comes and goes: what is left of it afterwards, and what survives a power cut of the hub."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.testbed.bed import PROGRAMS, bed
from tests.testbed.cgroups import Cgroup, hierarchies, mounted
from tests.testbed.network import NAMESPACES
from tests.testbed.records import SiteLock, clear_up, read_record
from tests.testbed.requirements import need
from tests.testbed.site import TESTS, BedSpec, Site, machines
from tests.testbed.waiting import wait_for

pytestmark = [pytest.mark.machines, pytest.mark.xdist_group("bed")]
HUB_ONLY = BedSpec(machines=machines(edges=0))
OWNER = """
import sys
from pathlib import Path
from tests.testbed.bed import bed
from tests.testbed.site import BedSpec, machines
with bed(Path(sys.argv[1]), spec=BedSpec(machines=machines(edges=0))) as own:
    print(own.spec.site.prefix, flush=True)
    sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def _needs_machines() -> None:
    need("machines", *PROGRAMS, "kubectl")


def test_a_hub_keeps_its_data_over_a_power_cut_and_nothing_is_left_when_the_bed_is_gone(tmp_path: Path) -> None:
    before = _settings()
    with bed(tmp_path, spec=HUB_ONLY) as own:
        site = own.spec.site
        own.kubectl("create", "configmap", "kept", "--from-literal=a=b")
        own.machine("hub").power_off()
        assert not own.machine("hub").on
        own.machine("hub").power_on()
        wait_for("the hub to be Ready", lambda: own.readiness() == {"hub": True}, 60.0)
        assert own.get("configmap", "kept")["data"] == {"a": "b"}
        assert all(_traces(site).values())
    assert not any(_traces(site).values())
    assert not (tmp_path / "hub/disk").exists()
    assert _settings() == before


def test_a_bed_dies_with_its_owner_and_the_next_one_clears_up(tmp_path: Path) -> None:
    owner = subprocess.Popen(
        [sys.executable, "-c", OWNER, str(tmp_path)],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    with owner:
        assert owner.stdout is not None
        prefix = owner.stdout.readline().strip()
        (site,) = [one for one in TESTS if one.prefix == prefix]
        assert Cgroup(prefix, "hub").pids() != []
        owner.send_signal(signal.SIGKILL)
    wait_for("the death of the machine", lambda: Cgroup(prefix, "hub").pids() == [], 20.0)
    assert read_record(site) is not None
    with SiteLock(site) as lock:
        wait_for("the lock of the dead bed", lock.try_take, 20.0)
        clear_up(site)  # as the next bed does
    assert not any(_traces(site).values())


def _traces(site: Site) -> dict[str, list[str]]:
    """What a bed has on this computer outside of its folder."""
    groups = [path for names in hierarchies() for path in mounted(names).iterdir()]
    mounts = Path("/proc/self/mounts").read_text().splitlines()
    places = {
        "control groups": [path.name for path in groups],
        "links": [path.name for path in Path("/sys/class/net").iterdir()],
        "network namespaces": [path.name for path in NAMESPACES.iterdir()],
        "mounts": [line.split()[1].rsplit("/", 1)[-1] for line in mounts],
    }
    return {what: [name for name in names if name.startswith(f"{site.prefix}-")] for what, names in places.items()}


def _settings() -> list[str]:
    """Settings of this computer's kernel that kubelets like to change."""
    names = ["vm/overcommit_memory", "vm/panic_on_oom", "kernel/panic", "kernel/panic_on_oops"]
    return [(Path("/proc/sys") / name).read_text() for name in names]

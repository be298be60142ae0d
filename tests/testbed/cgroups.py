"""Control groups of the machines: each sees its own group as the root of all (version 1)."""

from __future__ import annotations

import contextlib
import os
import signal
from pathlib import Path

from tests.testbed.errors import Missing
from tests.testbed.waiting import wait_for

ROOT = Path("/sys/fs/cgroup")
# What kubelet, containerd and runc ask for; the last is the one without a controller that systemd names its own.
NEEDED = ("cpu", "cpuacct", "cpuset", "memory", "devices", "freezer", "blkio", "pids", "name=systemd")


def hierarchies() -> list[str]:
    """The hierarchies of this computer, as mount options: "cpu,cpuacct", "memory", ..., "name=systemd".

    Raises:
        Missing: a controller is not there as version 1.
    """
    lines = [line.split(":") for line in Path("/proc/self/cgroup").read_text().splitlines()]
    present = [names for _, names, _ in lines if set(names.split(",")) & set(NEEDED)]
    missing = set(NEEDED) - {name for names in present for name in names.split(",")}
    if missing:
        raise Missing(
            f"this computer has no control groups of version 1 for {', '.join(sorted(missing))}; the machines of the "
            "test bed were tried with version 1 only: boot with systemd.unified_cgroup_hierarchy=0, "
            "or use a cluster of your own (FLEET_TEST_CLUSTER=kubeconfig and KUBECONFIG)"
        )
    return present


class Cgroup:
    """The control group of one machine, in every hierarchy."""

    def __init__(self, bed: str, machine: str) -> None:
        self._path = f"{bed}-bed/{machine}"

    def make(self) -> None:
        """Make the group, with every core: kubelet gives pods all that it sees.

        A bed that was started with an affinity (taskset) keeps it: a control group does not take it away.
        """
        for names in hierarchies():
            folder = mounted(names) / self._path
            for one in (folder.parent, folder):
                one.mkdir(exist_ok=True)
                if "cpuset" in names.split(","):  # a group without them takes no process
                    for setting in ("cpuset.cpus", "cpuset.mems"):
                        (one / setting).write_text((one.parent / setting).read_text())

    def entrances(self) -> list[Path]:
        """The files that a process writes its id to."""
        return [mounted(names) / self._path / "cgroup.procs" for names in hierarchies()]

    def pids(self) -> list[int]:
        """Every process of the machine, its pods included."""
        found: list[int] = []
        for folder, _, _ in os.walk(mounted("pids") / self._path):
            with contextlib.suppress(OSError):  # a pod's group that ends while we look
                found += [int(line) for line in (Path(folder) / "cgroup.procs").read_text().split()]
        return found

    def kill(self, timeout_s: float = 10.0) -> None:
        """Kill what is in the group until nothing is."""

        def empty() -> bool:
            for pid in (left := self.pids()):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            return not left

        wait_for(f"the end of the processes of {self._path}", empty, timeout_s, every_s=0.01)

    def remove(self) -> None:
        """Remove the group and those in it."""
        for names in hierarchies():
            _remove_tree(mounted(names) / self._path)
            with contextlib.suppress(OSError):  # other machines of the bed are in it
                (mounted(names) / self._path).parent.rmdir()


def mounted(names: str) -> Path:
    """Where a hierarchy is mounted: "cpu,cpuacct" and "name=systemd" as well."""
    return ROOT / names.removeprefix("name=")


def _remove_tree(folder: Path) -> None:
    for inner, _, _ in os.walk(folder, topdown=False):

        def gone(inner: str = inner) -> bool:
            try:
                Path(inner).rmdir()
            except FileNotFoundError:
                return True
            except OSError:  # the kernel is still at the last process
                return False
            return True

        wait_for(f"the end of {inner}", gone, timeout_s=5.0, every_s=0.01)

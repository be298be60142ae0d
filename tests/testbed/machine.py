"""One machine: namespaces, a disk folder, and a power button."""

from __future__ import annotations

import os
import shlex
import subprocess
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tests.testbed.cgroups import Cgroup, hierarchies
from tests.testbed.configuration import faces, hosts
from tests.testbed.network import NAMESPACES, Lan
from tests.testbed.site import BedSpec, MachineSpec

INIT = Path(__file__).with_name("machine-init")


@dataclass(frozen=True)
class Parts:
    """What every machine shares of this computer; only read."""

    programs: tuple[Path, ...]
    images: Path


class Machine:
    """A machine whose processes are children of this process, and end with it."""

    def __init__(self, spec: BedSpec, index: int, folder: Path, parts: Parts) -> None:
        self.spec: MachineSpec = spec.machines[index]
        self.folder = folder
        self._bed = spec
        self._index = index
        self._parts = parts
        self._lan = Lan(spec)
        self.cgroup = Cgroup(spec.site.prefix, self.spec.name)
        self._process: subprocess.Popen[bytes] | None = None
        for name in ("conf/programs", "conf/faces", "conf/cni", "log", "disk/lib", "disk/log", "disk/etcd"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / "disk/etcd").chmod(0o700)

    def write(self, files: Mapping[str, str]) -> None:
        """Write configuration files; paths are from the machine's `conf`."""
        for name, content in files.items():
            path = self.folder / "conf" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content)

    def set_program(self, name: str, command: list[str], before: str = "") -> None:
        """Have the machine run a program whenever it is on; `before` is a line of shell that waits for something."""
        self.write({f"programs/{name}": f"{before}\nexec {shlex.join(command)}\n"})

    @property
    def on(self) -> bool:
        """Whether the machine runs."""
        return self._process is not None and self._process.poll() is None

    def power_on(self) -> int:
        """Start the machine if it is off; the process id of its outside."""
        if self.on and self._process is not None:
            return self._process.pid
        self.cgroup.make()
        self._lan.card_on(self._index)
        self._put_on_faces()
        join = [f"echo $$ > {shlex.quote(str(path))}" for path in self.cgroup.entrances()]
        isolate = "exec unshare --fork --kill-child=SIGKILL --pid --mount --uts --ipc --cgroup --mount-proc"
        script = "; ".join([*join, f"{isolate} {shlex.quote(str(INIT))}"])
        network = NAMESPACES / self._bed.site.namespace(self.spec.name)
        with (self.folder / "log/init.log").open("ab") as log:
            self._process = subprocess.Popen(
                ["setpriv", "--pdeathsig", "KILL", "nsenter", f"--net={network}", "bash", "-ec", script],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=self._environment(),
                start_new_session=True,
            )
        (self.folder / "pid").write_text(str(self._process.pid))
        return self._process.pid

    def power_off(self) -> None:
        """Cut the power: every process dies at once; the disk stays."""
        if self._process is None:
            return
        self._process.kill()
        self._process.wait()
        self._process = None
        self.cgroup.kill()
        self._lan.card_off(self._index)
        self.cgroup.remove()

    def _put_on_faces(self) -> None:
        ids = self.folder / "disk/machine-id"
        if not ids.exists():
            ids.write_text(uuid.uuid4().hex)
        content = faces(self.spec, ids.read_text(), str(uuid.uuid4()), hosts(self._bed))
        self.write({f"faces/{name}": text for name, text in content.items()})

    def _environment(self) -> dict[str, str]:
        return {
            "PATH": os.environ["PATH"],
            "MACHINE": str(self.folder),
            "PROGRAMS": "\n".join(str(path) for path in self._parts.programs),
            "IMAGES": str(self._parts.images),
            "CGROUPS": " ".join(hierarchies()),
            "NAME": self.spec.name,
        }

"""What beds there are on this computer: a lock and a record per site, so that a new one clears up after a dead one."""

from __future__ import annotations

import fcntl
import json
import shutil
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

from tests.testbed import kernel
from tests.testbed.cgroups import Cgroup
from tests.testbed.network import Lan
from tests.testbed.site import BedSpec, MachineSpec, Role, Site

ROOT = Path("/run/fleet-testbed")
# A folder is only ever removed when this file in it says that it is a bed's.
MARK = ".fleet-testbed"


@dataclass(frozen=True)
class Record:
    """A bed that runs, or was killed before it could clear up."""

    folder: str
    machines: tuple[str, ...]
    keeper: int  # process id


class SiteLock:
    """One site's lock: whoever holds it is the only one who makes, changes or clears up what has its names."""

    def __init__(self, site: Site) -> None:
        self.site = site
        self._folder = ROOT / site.prefix
        self._folder.mkdir(parents=True, exist_ok=True)
        self._file = (self._folder / "lock").open("a")

    def try_take(self) -> bool:
        """Take the lock unless another has it."""
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def fileno(self) -> int:
        """To hand it to a child: the lock is held until the last holder ends."""
        return self._file.fileno()

    def close(self) -> None:
        """Let go of it, unless a child holds it too."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def place(site: Site) -> Path:
    """The folder of a site's record, which other processes look into."""
    return ROOT / site.prefix


def socket_path(site: Site) -> Path:
    """Where the keeper of a site's bed takes orders."""
    return place(site) / "keeper.sock"


def read_record(site: Site) -> Record | None:
    """What the last bed of a site left; None when it cleared up, or there was none."""
    path = place(site) / "record.json"
    if not path.exists():
        return None
    content = json.loads(path.read_text())
    return Record(content["folder"], tuple(content["machines"]), content["keeper"])


def write_record(site: Site, record: Record) -> None:
    """Say what this bed is made of, before anything of it is made."""
    (place(site) / "record.json").write_text(json.dumps(asdict(record)))


def clear_up(site: Site) -> None:
    """Remove what is left of a site's bed, by its record only; the caller holds the site's lock."""
    record = read_record(site)
    if record is None:
        return
    for name in record.machines:
        group = Cgroup(site.prefix, name)
        group.kill()
        group.remove()
    machines = tuple(MachineSpec(name, Role.GATEWAY, holds_data=False) for name in record.machines)
    Lan(BedSpec(site, machines)).down()
    _remove_disks(Path(record.folder), record.machines)
    socket_path(site).unlink(missing_ok=True)
    (place(site) / "record.json").unlink()
    kernel.leave(site.prefix)


def _remove_disks(folder: Path, machines: Iterable[str]) -> None:
    """Remove the machines' disks; logs and configuration stay for who wants to know what happened."""
    if (folder / MARK).exists():
        for name in machines:
            shutil.rmtree(folder / name / "disk", ignore_errors=True)

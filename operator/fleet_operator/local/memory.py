"""Memory of running containers, read from /proc.

A container's memory is the sum of the PSS of its processes: pages that several processes share are divided among
them, as a memory cgroup counts each page once.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Collection, Iterator
from pathlib import Path

_PROC = Path("/proc")
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
_GROUP_FIELD = 2
"""Place of the process group in /proc/PID/stat after the command's name (proc(5): field 5)."""


def members(groups: Collection[int]) -> dict[int, list[int]]:
    """The processes of each process group that has some."""
    found: dict[int, list[int]] = defaultdict(list)
    for pid, group in _all_groups():
        if group in groups:
            found[group].append(pid)
    return dict(found)


def resident_bytes(pid: int) -> int:
    """RSS of a process: cheap, and never below its PSS; 0 when it has ended."""
    try:
        return int((_PROC / str(pid) / "statm").read_text().split()[1]) * _PAGE_BYTES
    except (OSError, IndexError):
        return 0


def proportional_bytes(pid: int) -> int:
    """PSS of a process; 0 when it has ended."""
    try:
        text = (_PROC / str(pid) / "smaps_rollup").read_text()
    except OSError:
        return 0
    lines = [line for line in text.splitlines() if line.startswith("Pss:")]
    return int(lines[0].split()[1]) * 1024 if lines else 0


def machine_bytes() -> int:
    """Memory that this process and what it starts may use: the machine's, or its cgroup's when that is less."""
    total = os.sysconf("SC_PHYS_PAGES") * _PAGE_BYTES
    limits = [total]
    for name in ("memory.max", "memory/memory.limit_in_bytes"):
        try:
            limits.append(int((Path("/sys/fs/cgroup") / name).read_text()))
        except (OSError, ValueError):  # no such cgroup version, or "max"
            continue
    return min(limits)


def _all_groups() -> Iterator[tuple[int, int]]:
    for folder in os.scandir(_PROC):
        if not folder.name.isdigit():
            continue
        try:
            stat = Path(folder.path, "stat").read_text()
        except OSError:  # ended meanwhile
            continue
        yield int(folder.name), int(stat.rpartition(")")[2].split()[_GROUP_FIELD])

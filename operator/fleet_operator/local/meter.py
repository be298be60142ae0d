"""Watches the memory of all containers: the peak of all together, and who is over its limit."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence

from fleet_operator.local import memory
from fleet_operator.local.pod import Pod
from fleet_operator.local.workloads import Container

_LIMIT_EVERY_S = 0.5
_PEAK_EVERY_S = 1.0


class MemoryMeter:
    """Samples /proc now and then.

    Attributes:
        peak_bytes: The most that the containers and this process have used together.
    """

    def __init__(self) -> None:
        self.peak_bytes = 0
        self._next_limit_s = 0.0
        self._next_peak_s = 0.0

    def over_limit(self, pods: Sequence[Pod], now_s: float) -> list[tuple[Pod, str, str]]:
        """The containers that use more than their limit: pod, container, and the message."""
        if now_s < self._next_limit_s or not pods:
            return []
        self._next_limit_s = now_s + _LIMIT_EVERY_S
        running = [(pod, container, process.pid) for pod in pods for container, process in pod.running]
        processes = memory.members({pid for _, _, pid in running})
        self._sample_peak(processes.values(), now_s)
        found = []
        for pod, container, group in running:
            used = _used_bytes(processes.get(group, []), container.memory_limit_bytes)
            if used > container.memory_limit_bytes:
                found.append((pod, container.name, _message(container, used)))
        return found

    def _sample_peak(self, groups: Iterable[Sequence[int]], now_s: float) -> None:
        if now_s < self._next_peak_s:
            return
        self._next_peak_s = now_s + _PEAK_EVERY_S
        pids = [os.getpid(), *(pid for group in groups for pid in group)]
        self.peak_bytes = max(self.peak_bytes, sum(memory.proportional_bytes(pid) for pid in pids))


def _used_bytes(pids: Sequence[int], limit_bytes: float) -> float:
    """Memory of one container; the exact figure is costly, so it is taken only when the cheap one is too high."""
    resident = sum(memory.resident_bytes(pid) for pid in pids)
    if resident <= limit_bytes:
        return resident
    return sum(memory.proportional_bytes(pid) for pid in pids)


def _message(container: Container, used: float) -> str:
    return (
        f"was killed: it used {used / 2**20:.0f} MiB of memory, and its limit is "
        f"{container.memory_limit_bytes / 2**20:.0f} MiB; raise the limit of {container.name} in the FleetSpec"
    )

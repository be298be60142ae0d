"""A cluster of one machine: takes compiled manifests and runs their Jobs as processes.

What differs from a cluster is written at the top of `environment.py` and of `pod.py`, and here:
- memory limits are watched and enforced as an OOM kill; CPU limits cannot be, without cgroups. So below the level of
  real time no more pods run at once than there are cores, the highest level first;
- Jobs of the real-time level start at once, requests or not: vehicles wait for nothing;
- the wait before another try starts at a fraction of a second.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from fleet_operator.local.addresses import Addresses
from fleet_operator.local.environment import Place, check_command
from fleet_operator.local.events import ContainerDied, Event, JobFailed, JobSucceeded, PodStarted, Subject
from fleet_operator.local.meter import MemoryMeter
from fleet_operator.local.pod import Phase, Pod, delay_s
from fleet_operator.local.processes import Nursery
from fleet_operator.local.volumes import Volumes
from fleet_operator.local.workloads import Job, Service, UnsupportedManifest, parse_job, parse_service

Manifest = Mapping[str, Any]
_PAUSE_S = 0.02
_QUICK_STOP_S = 1.5
_REAL_TIME_PRIORITY = 1_000_000_000


class JobState(StrEnum):
    """Where a Job is in its life."""

    SUSPENDED = "Suspended"
    PENDING = "Pending"
    RUNNING = "Running"
    SUCCEEDED = "Succeeded"
    FAILED = "Failed"


@dataclass(frozen=True)
class Capacity:
    """What the machine has for pods."""

    cores: int
    memory_bytes: float


@dataclass
class _Entry:
    """A Job and how far it is."""

    job: Job
    priority: int
    order: int
    subject: Subject
    state: JobState
    pod: Pod | None = None
    address: str = ""
    failures: int = 0
    attempts: int = 0
    pod_number: int = 0
    start_at_s: float = 0.0
    started_s: float = 0.0
    message: str = ""


@dataclass
class Machine:
    """Runs Jobs; call `step` again and again, from the thread that made it.

    Args:
        folder: Where logs and volumes go.
        capacity: What pods may request together.
        listen: Told what happens.
        now_s: A clock that only goes forward.
    """

    folder: Path
    capacity: Capacity
    listen: Callable[[Event], None]
    addresses: Addresses
    now_s: Callable[[], float] = time.monotonic
    meter: MemoryMeter = field(init=False)
    _nursery: Nursery = field(init=False)
    _volumes: Volumes = field(init=False)
    _entries: dict[str, _Entry] = field(init=False, default_factory=dict)
    _leaving: list[_Entry] = field(init=False, default_factory=list)
    _services: dict[str, Service] = field(init=False, default_factory=dict)
    _priorities: dict[str, int] = field(init=False, default_factory=dict)
    _pods: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self._nursery = Nursery()
        self._volumes = Volumes(self.folder / "volumes")
        self.meter = MemoryMeter()

    def apply(self, objects: Iterable[Manifest]) -> None:
        """Take over objects; a Job that is there already is left as it is.

        Raises:
            UnsupportedManifest: an object is of a kind, or asks for something, that the machine does not have.
        """
        for manifest in objects:
            name = manifest["metadata"]["name"]
            match manifest["kind"]:
                case "PriorityClass":
                    self._priorities[name] = manifest["value"]
                case "ConfigMap":
                    self._volumes.add_config_map(manifest)
                case "Service":
                    self._services[name] = parse_service(manifest)
                case "Job":
                    self._add(parse_job(manifest))
                case kind:
                    raise UnsupportedManifest(f"{kind} {name}: the local runner does not know this kind of object")

    def delete(self, names: Iterable[str]) -> None:
        """Stop Jobs and forget them."""
        for name in names:
            entry = self._entries.pop(name, None)
            if entry is not None:
                self._stop(entry, entry.job.grace_s)
                self._leaving.append(entry)

    def state(self, name: str) -> JobState | None:
        """Where a Job is; None when there is none of that name."""
        entry = self._entries.get(name)
        return None if entry is None else entry.state

    def message(self, name: str) -> str:
        """Why a Job failed."""
        return self._entries[name].message

    def step(self) -> None:
        """Start, watch and end processes; returns at once."""
        now_s = self.now_s()
        for entry in [*self._entries.values(), *self._leaving]:
            self._advance(entry, now_s)
        self._leaving = [entry for entry in self._leaving if entry.pod is not None]
        for entry in self._next_to_start(now_s):
            self._start(entry, now_s)
        self._watch_memory(now_s)

    def run_while(self, wanted: Callable[[], bool]) -> None:
        """Step as long as something is wanted."""
        while wanted():
            self.step()
            time.sleep(_PAUSE_S)

    def close(self) -> None:
        """Stop everything, within two seconds, and give back what the run had."""
        self.delete(list(self._entries))
        deadline_s = self.now_s() + _QUICK_STOP_S
        for entry in self._leaving:
            self._stop(entry, _QUICK_STOP_S)
        while any(entry.pod is not None for entry in self._leaving) and self.now_s() < deadline_s + 1:
            self._leaving_step()
            time.sleep(_PAUSE_S)
        self._nursery.close()
        self.addresses.close()
        self._volumes.remove()

    def _leaving_step(self) -> None:
        for entry in self._leaving:
            self._advance(entry, self.now_s())

    def _add(self, job: Job) -> None:
        if job.name in self._entries:
            return
        for container in job.containers:
            check_command(container)
        state = JobState.SUSPENDED if job.suspended else JobState.PENDING
        priority = self._priorities[job.priority_class]
        subject = Subject.of(job.name, job.labels)
        self._entries[job.name] = _Entry(job, priority, len(self._entries), subject, state)

    def _next_to_start(self, now_s: float) -> list[_Entry]:
        """The Jobs that fit now, the highest priority first; nothing overtakes a Job that does not fit yet."""
        waiting = [each for each in self._entries.values() if each.state is JobState.PENDING and each.pod is None]
        chosen: list[_Entry] = []
        for entry in sorted(waiting, key=lambda each: (-each.priority, each.order)):
            if entry.start_at_s > now_s:
                continue
            if not self._fits(entry, chosen):
                break
            chosen.append(entry)
        return chosen

    def _fits(self, entry: _Entry, chosen: Sequence[_Entry]) -> bool:
        if entry.priority >= _REAL_TIME_PRIORITY:
            return True
        running = [each for each in (*self._entries.values(), *self._leaving) if each.pod is not None]
        running += chosen
        patient = [each for each in running if each.priority < _REAL_TIME_PRIORITY]
        if not patient:
            return True
        cores = sum(each.job.cpu_cores for each in running) + entry.job.cpu_cores
        memory = sum(each.job.memory_bytes for each in running) + entry.job.memory_bytes
        has_room = cores <= self.capacity.cores and memory <= self.capacity.memory_bytes
        return has_room and len(patient) < self.capacity.cores

    def _start(self, entry: _Entry, now_s: float) -> None:
        entry.address = entry.address or self.addresses.take()
        self._pods += 1
        entry.pod_number = self._pods
        place = Place(
            address=entry.address,
            hosts=self._hosts(),
            folders=self._volumes.folders(entry.job, entry.pod_number),
            ports=frozenset(port for each in entry.job.containers for port in each.ports.values()),
        )
        entry.attempts += 1
        entry.started_s = entry.started_s or now_s
        entry.state = JobState.RUNNING
        entry.pod = Pod(entry.job, place, self._nursery, self.folder / "logs", self._died(entry))
        self.listen(PodStarted(entry.subject, entry.attempts))
        entry.pod.step(now_s)

    def _hosts(self) -> dict[str, str]:
        """Host names of all Services; a Job keeps its address over all tries, so names never change meaning."""
        found: dict[str, str] = {}
        for service in self._services.values():
            for entry in self._entries.values():
                if service.selects(entry.job):
                    entry.address = entry.address or self.addresses.take()
                    found.update(dict.fromkeys(service.hosts, entry.address))
        return found

    def _died(self, entry: _Entry) -> Callable[[str, str], None]:
        return lambda container, reason: self.listen(ContainerDied(entry.subject, container, reason, entry.attempts))

    def _advance(self, entry: _Entry, now_s: float) -> None:
        if entry.pod is None:
            return
        entry.pod.step(now_s)
        if entry.pod.phase is not Phase.STOPPED:
            return
        outcome, entry.pod = entry.pod.outcome, None
        self._volumes.forget(entry.job, entry.pod_number)
        if entry.job.name not in self._entries or self._entries[entry.job.name] is not entry:
            self._give_back(entry)
        elif outcome is not None and outcome.code == 0:
            entry.state = JobState.SUCCEEDED
            self._give_back(entry)
            self.listen(JobSucceeded(entry.subject, now_s - entry.started_s))
        elif outcome is not None:
            self._failed(entry, outcome.permanent, outcome.reason, now_s)

    def _failed(self, entry: _Entry, permanent: bool, reason: str, now_s: float) -> None:
        entry.failures += 1
        if permanent or entry.failures > entry.job.backoff_limit:
            entry.state = JobState.FAILED
            tried = "" if permanent else f" after {entry.failures} tries"
            entry.message = f"{entry.subject} failed{tried}: {reason}"
            self._give_back(entry)
            self.listen(JobFailed(entry.subject, entry.message))
            return
        entry.state = JobState.PENDING
        entry.start_at_s = now_s + delay_s(entry.failures)
        self.listen(ContainerDied(entry.subject, entry.job.main.name, reason, entry.attempts))

    def _give_back(self, entry: _Entry) -> None:
        if entry.address:
            self.addresses.give_back(entry.address)
            entry.address = ""

    def _stop(self, entry: _Entry, grace_s: float) -> None:
        if entry.pod is not None:
            entry.pod.stop(self.now_s(), grace_s)

    def _watch_memory(self, now_s: float) -> None:
        pods = [entry.pod for entry in (*self._entries.values(), *self._leaving) if entry.pod is not None]
        for pod, container, reason in self.meter.over_limit(pods, now_s):
            pod.kill(container, reason)

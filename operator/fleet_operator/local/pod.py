"""One try of a Job: its containers as processes, sidecars first, the main container when they have started.

Differences to a kubelet: sidecars are started side by side and probed ten times a second, since seconds matter in a
demonstration; a sidecar that says with its exit code that it can never start ends the try (a kubelet would start it
again for ever, and the operator watches for that).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import Enum, auto
from pathlib import Path

from fleet_operator.local.environment import Place, command_of
from fleet_operator.local.probe import HttpProbe
from fleet_operator.local.processes import Nursery, Process
from fleet_operator.local.workloads import Container, Job

_PROBE_TIMEOUT_S = 2.0
_FIRST_DELAY_S = 0.2
_LONGEST_DELAY_S = 10.0
_STABLE_S = 10.0
_TAIL_LINES = 15
_TAIL_BYTES = 8192


def delay_s(failures: int) -> float:
    """Wait before the next try: doubled with every failure. Kubernetes begins with 10 s, which is long for a test."""
    return min(_LONGEST_DELAY_S, _FIRST_DELAY_S * 2.0 ** max(0, failures - 1))


class Phase(Enum):
    """Where a pod is in its life."""

    STARTING = auto()
    RUNNING = auto()
    STOPPING = auto()
    STOPPED = auto()


@dataclass(frozen=True)
class Outcome:
    """How a try ended.

    Args:
        code: Exit code of the container that ended it.
        permanent: Whether the code says that another try would end alike.
        reason: What happened, in words; "" on success.
    """

    code: int
    permanent: bool = False
    reason: str = ""


@dataclass
class _Slot:
    """A container of the pod and the process that it has now."""

    container: Container
    log: Path
    process: Process | None = None
    probe: HttpProbe | None = None
    ready: bool = False
    killed_for: str = ""
    failures: int = 0
    started_s: float = 0.0
    start_at_s: float = 0.0


@dataclass
class Pod:
    """The containers of one try; `step` moves it on and never waits.

    Args:
        job: What runs.
        place: Where.
        nursery: Starts the processes.
        logs: Folder of the containers' logs.
        died: Told when a sidecar is started again: container, reason.
    """

    job: Job
    place: Place
    nursery: Nursery
    logs: Path
    died: Callable[[str, str], None]
    phase: Phase = Phase.STARTING
    outcome: Outcome | None = None
    _sidecars: list[_Slot] = field(init=False)
    _main: _Slot = field(init=False)
    _kill_at_s: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        self._sidecars = [_Slot(each, self.log(each.name)) for each in self.job.sidecars]
        self._main = _Slot(self.job.main, self.log(self.job.main.name))

    def log(self, container: str) -> Path:
        """What a container printed, over all tries."""
        return self.logs / self.job.name / f"{container}.log"

    @property
    def running(self) -> Iterator[tuple[Container, Process]]:
        """Containers that have a process."""
        for slot in (*self._sidecars, self._main):
            if slot.process is not None:
                yield slot.container, slot.process

    def step(self, now_s: float) -> None:
        """Start what is due, see what has ended."""
        if self.phase in {Phase.STARTING, Phase.RUNNING}:
            for slot in self._sidecars:
                self._tend(slot, now_s)
        if self.phase is Phase.STARTING and all(slot.ready for slot in self._sidecars):
            self._start(self._main, now_s)
            self.phase = Phase.RUNNING
        if self.phase is Phase.RUNNING:
            self._watch_main(now_s)
        if self.phase is Phase.STOPPING:
            self._finish(now_s)

    def stop(self, now_s: float, grace_s: float) -> None:
        """Ask every process to end; `step` kills those that have not after the grace period."""
        if self.phase is Phase.STOPPED:
            return
        self._kill_at_s = now_s + grace_s
        self.phase = Phase.STOPPING
        for slot in (*self._sidecars, self._main):
            if slot.probe is not None:
                slot.probe.close()
        for _, process in self.running:
            process.terminate()

    def kill(self, container: str, reason: str) -> None:
        """End one container at once, as the kernel does when its memory is over the limit."""
        for slot in (*self._sidecars, self._main):
            if slot.container.name == container and slot.process is not None:
                slot.killed_for = reason
                slot.process.kill()

    def _start(self, slot: _Slot, now_s: float) -> None:
        environment = self.place.environment(slot.container)
        command = command_of(slot.container, environment)
        slot.process = self.nursery.start(command, environment, self.place.folder(slot.container), slot.log)
        slot.started_s, slot.killed_for = now_s, ""
        probe = slot.container.probe
        if probe is not None:
            slot.probe = HttpProbe(self.place.address, probe.port, probe.path, _PROBE_TIMEOUT_S)

    def _tend(self, slot: _Slot, now_s: float) -> None:
        """Keep a sidecar running; it is ready once its probe has passed, and stays so for the pod's start."""
        if slot.process is None:
            if now_s >= slot.start_at_s:
                self._start(slot, now_s)
            return
        code = slot.process.poll()
        if code is not None:
            self._sidecar_died(slot, code, now_s)
            return
        if slot.ready:
            return
        probe = slot.container.probe
        slot.ready = probe is None or (slot.probe is not None and slot.probe.passed(now_s))
        if probe is not None and not slot.ready and now_s - slot.started_s > probe.timeout_s:
            slot.killed_for = f"did not answer {probe.path} on port {probe.port} within {probe.timeout_s:g} s"
            slot.process.kill()

    def _sidecar_died(self, slot: _Slot, code: int, now_s: float) -> None:
        reason = self._reason(slot, code)
        slot.failures = 1 if now_s - slot.started_s > _STABLE_S else slot.failures + 1
        slot.process, slot.start_at_s = None, now_s + delay_s(slot.failures)
        permanent = code in self.job.permanent_codes and not slot.ready
        if permanent or slot.failures > self.job.backoff_limit:
            self._end(Outcome(code, permanent, reason), now_s)
            return
        self.died(slot.container.name, reason)

    def _watch_main(self, now_s: float) -> None:
        code = None if self._main.process is None else self._main.process.poll()
        if code is None:
            return
        reason = self._reason(self._main, code) if code else ""
        self._main.process = None
        self._end(Outcome(code, code in self.job.permanent_codes, reason), now_s)

    def _end(self, outcome: Outcome, now_s: float) -> None:
        self.outcome = outcome
        self.stop(now_s, self.job.grace_s)

    def _finish(self, now_s: float) -> None:
        for slot in (*self._sidecars, self._main):
            if slot.process is not None and slot.process.poll() is not None:
                slot.process = None
        for _, process in self.running:
            if now_s >= self._kill_at_s:
                process.kill()
        if not any(self.running):
            self.phase = Phase.STOPPED

    def _reason(self, slot: _Slot, code: int) -> str:
        what = slot.killed_for or f"ended with exit code {code}{_signal_words(code)}"
        tail = last_lines(slot.log)
        said = f"the end of {slot.log}:\n{tail}" if tail else f"it wrote nothing to {slot.log}"
        return f"{slot.container.name} {what}; {said}"


def last_lines(log: Path) -> str:
    """The end of a log, indented."""
    try:
        with log.open("rb") as file:
            file.seek(0, 2)
            file.seek(max(0, file.tell() - _TAIL_BYTES))
            lines = file.read().decode(errors="replace").splitlines()
    except OSError:
        return ""
    return "\n".join(f"  {line}" for line in lines[-_TAIL_LINES:])


def _signal_words(code: int) -> str:
    match code:
        case 137:
            return " (killed)"
        case 139:
            return " (segmentation fault)"
        case 143:
            return " (terminated)"
        case 127:
            return " (its command was not found)"
        case _:
            return ""

"""What an operator process has done and needs, asked from outside."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import time
from dataclasses import dataclass, field
from pathlib import Path

import httpx

from tests.testbed.processes import Program

_CALLS = re.compile(r'fleet_operator_api_calls_total\{code="(\d+)",verb="(\w+)"\} (\S+)')
_GAUGE = re.compile(r"^(fleet_operator_\w+) (\S+)$", re.MULTILINE)
_PORT = "FLEET_OPERATOR_HEALTH_PORT"
_EVERY_S = 0.25


@dataclass(frozen=True)
class Sample:
    """One look.

    Args:
        calls: Answers of the API server so far, by verb; those that failed are under "failed".
        fleets, busy: Fleets that are known; fleets that wait for a pass or have one.
        rss_mib: Resident memory.
        cpu_s: Processor time so far.
    """

    at_s: float
    calls: dict[str, float]
    fleets: float
    busy: float
    rss_mib: float
    cpu_s: float

    @property
    def writes(self) -> float:
        """Writes that were acknowledged, leases apart."""
        return sum(count for verb, count in self.calls.items() if verb in ("create", "patch", "delete"))


@dataclass
class Meter:
    """Looks at an operator.

    Args:
        program: Started.
        port: Where it answers.
    """

    program: Program
    port: int
    samples: list[Sample] = field(default_factory=list)

    async def look(self) -> Sample:
        """Ask now; waits until the operator answers."""
        async with httpx.AsyncClient(trust_env=False, timeout=30) as client:
            while True:
                try:
                    answer = await client.get(f"http://127.0.0.1:{self.port}/metrics")
                    break
                except httpx.TransportError:
                    if not self.program.running:
                        raise RuntimeError(f"the operator ended; see {self.program.log}") from None
                    await asyncio.sleep(0.1)
        calls: dict[str, float] = {}
        for code, verb, count in _CALLS.findall(answer.text):
            key = verb if code.startswith("2") else "failed"
            calls[key] = calls.get(key, 0.0) + float(count)
        gauges = {name: float(value) for name, value in _GAUGE.findall(answer.text)}
        busy = gauges["fleet_operator_fleets_due"] + gauges["fleet_operator_passes_running"]
        sample = Sample(
            time.perf_counter(), calls, gauges["fleet_operator_fleets"], busy, self._rss_mib(), self._cpu_s()
        )
        self.samples.append(sample)
        return sample

    async def follow(self) -> None:
        """Look all the time, until cancelled; an operator that is too busy to answer is asked again."""
        while True:
            with contextlib.suppress(RuntimeError, OSError, KeyError):
                await self.look()
            await asyncio.sleep(_EVERY_S)

    @property
    def peak_mib(self) -> float:
        """The most resident memory that it ever had."""
        return _field(Path(f"/proc/{self.program.pid}/status"), "VmHWM:")

    @property
    def pss_mib(self) -> float:
        """Memory that is its own, with its part of what is shared."""
        return _field(Path(f"/proc/{self.program.pid}/smaps_rollup"), "Pss:")

    def _rss_mib(self) -> float:
        return _field(Path(f"/proc/{self.program.pid}/status"), "VmRSS:")

    def _cpu_s(self) -> float:
        fields = Path(f"/proc/{self.program.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _field(file: Path, name: str) -> float:
    line = next(line for line in file.read_text().splitlines() if line.startswith(name))
    return float(line.split()[1]) / 1024


def busiest(samples: list[Sample], window_s: float) -> float:
    """The most writes a second within any window of this length."""
    best, first = 0.0, 0
    for sample in samples:
        while sample.at_s - samples[first].at_s > window_s:
            first += 1
        best = max(best, (sample.writes - samples[first].writes) / window_s)
    return best

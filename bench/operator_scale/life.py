"""The life of all fleets, and what is measured in it."""

from __future__ import annotations

import asyncio
import os
import sys
import time
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from bench.operator_scale.client import MERGE, Client, Manifest
from bench.operator_scale.effects import effects
from bench.operator_scale.fleets import FLOOR, NAMESPACE, Objects, fleet_spec, name
from bench.operator_scale.meter import Meter, Sample, busiest
from bench.operator_scale.site import Site, site
from fleet_operator.compiler.settings import Settings
from fleet_operator.resources.refs import FLEET_SPEC, JOB, SERVICE, kind_of

_BUSIEST_S = 5.0
_REST_S = 60.0
_QUIET_S = 5.0
_LEASE_WRITES = 10
_FLOOR_FLEETS = 300
_PATIENCE_S = 1800.0
_RESUMED, _STARTED = "all fleets resumed at once", "a start with all fleets evaluated"


@dataclass(frozen=True)
class Burst:
    """Objects a second.

    Args:
        objects: Applied by the operator, from the first to the last.
        writes: The same with status and events.
        busiest: Writes in the busiest seconds.
        floor: Applied by the floor.
    """

    objects: float
    writes: float
    busiest: float
    floor: float


@dataclass
class Figures:
    """All that was measured."""

    bursts: dict[str, Burst] = field(default_factory=dict)
    effects: dict[str, list[float]] = field(default_factory=dict)
    empty_mib: float = 0.0
    peak_mib: float = 0.0
    rest_rss_mib: float = 0.0
    rest_pss_mib: float = 0.0
    rest_calls: float = 0.0
    rest_cpu_s: float = 0.0
    cpu_s: float = 0.0
    calls: float = 0.0
    trained_s: float = 0.0
    done_s: float = 0.0
    load: list[float] = field(default_factory=list)


async def live(folder: Path, fleets: int, nodes: int, samples: int, pods: bool = True) -> Figures:
    """Live through all of it."""
    figures = Figures()
    figures.load.append(os.getloadavg()[0])
    async with site(folder, nodes, fleets, pods) as place, Client(place.plane.kubeconfig) as client:
        _say(f"{nodes} machines are ready")
        life = Life(place, client, fleets, figures)
        async with life.operator() as meter:
            await life.train(meter)
            await life.fly(meter)
        await life.await_evaluations()
        async with life.retraining() as meter:
            await life.rest(meter)
            count = min(samples, fleets)
            figures.effects = await effects(client, count)
            _say(f"time to effect: {count} fleets")
    figures.load.append(os.getloadavg()[0])
    return figures


class Life:
    """The stages.

    Args:
        place: Without an operator.
        fleets: How many.
        figures: Filled in.
    """

    def __init__(self, place: Site, client: Client, fleets: int, figures: Figures) -> None:
        self._place = place
        self._client = client
        self._fleets = fleets
        self._figures = figures
        self._objects = Objects(place.library, place.storage.uri, Settings())
        self._resumed_s = 0.0
        self._rested: Meter | None = None

    @asynccontextmanager
    async def operator(self) -> AsyncIterator[Meter]:
        """An operator at work."""
        program, port = self._place.operator()
        program.start()
        meter = Meter(program, port)
        following = asyncio.create_task(meter.follow())
        try:
            yield meter
            if meter is not self._rested:
                self._spent(await meter.look())
            self._figures.peak_mib = max(self._figures.peak_mib, meter.peak_mib)
        finally:
            following.cancel()
            program.stop(timeout_s=30.0)

    def _spent(self, last: Sample) -> None:
        self._figures.cpu_s += last.cpu_s
        self._figures.calls += sum(last.calls.values())

    async def train(self, meter: Meter) -> None:
        """All fleets are made, and trained; then they wait."""
        await asyncio.sleep(3.0)
        self._figures.empty_mib = (await meter.look()).rss_mib
        began = time.perf_counter()
        await self._client.apply_all([fleet_spec(index) for index in range(self._fleets)])
        await self._await_phase("Suspended")
        self._figures.trained_s = time.perf_counter() - began
        _say(f"all trained after {self._figures.trained_s:.1f} s")
        await asyncio.sleep(_QUIET_S)

    async def fly(self, meter: Meter) -> None:
        """All fleets are resumed at once, while nobody else works."""
        with self._place.stopped():
            before_s = await self._floor(self._objects.flight)
            first = await meter.look()
            self._resumed_s = time.perf_counter()
            resumed = {"spec": {"suspend": False}}
            paths = [FLEET_SPEC.path(NAMESPACE, name(index)) for index in range(self._fleets)]
            await self._client.for_each(paths, lambda path: self._client.call("PATCH", path, resumed, MERGE))
            await self._burst(_RESUMED, (9, 13), meter, first, before_s)
            await self._floor_after(_RESUMED, self._objects.flight)

    async def await_evaluations(self) -> None:
        """Sensors and workflows end while no operator is there."""
        await self._wait("the ends of all Jobs of the flight", self._all_over)
        _say("all have flown")

    @asynccontextmanager
    async def retraining(self) -> AsyncIterator[Meter]:
        """An operator that is started while nobody else works, and finds all fleets evaluated."""
        stopped = ExitStack()
        with stopped:
            stopped.enter_context(self._place.stopped())
            before_s = await self._floor(self._objects.retraining)
            async with self.operator() as meter:
                first = await self._first_write(meter)
                await self._burst(_STARTED, (24, 15), meter, first, before_s)
                await self._floor_after(_STARTED, self._objects.retraining)
                stopped.close()
                yield meter

    async def _first_write(self, meter: Meter) -> Sample:
        """The last look before it began to write; the lease and the watches come before."""
        while True:
            await asyncio.sleep(0.05)
            if (await meter.look()).writes > _LEASE_WRITES:
                idle = [each for each in meter.samples if each.writes <= _LEASE_WRITES]
                return idle[-1] if idle else meter.samples[0]

    async def _burst(self, what: str, counts: tuple[int, int], meter: Meter, first: Sample, before_s: float) -> Sample:
        """Wait for the end of a burst.

        Args:
            counts: Jobs of each fleet at its end; objects that were applied for each fleet in it.
            first: The look at its beginning.
            before_s: Objects a second of the floor before it.
        """
        jobs, objects = (count * self._fleets for count in counts)
        await self._wait(what, lambda: self._has_jobs(jobs), 0.1)
        last = await meter.look()
        taken_s = last.at_s - first.at_s
        inside = [each for each in meter.samples if first.at_s <= each.at_s <= last.at_s]
        writes = (last.writes - first.writes) / taken_s
        burst = Burst(objects / taken_s, writes, busiest(inside, _BUSIEST_S), before_s)
        self._figures.bursts[what] = burst
        used = (last.cpu_s - first.cpu_s) / taken_s
        verbs = {verb: (count - first.calls.get(verb, 0.0)) / self._fleets for verb, count in last.calls.items()}
        said = ", ".join(f"{count:.1f} {verb}" for verb, count in sorted(verbs.items()))
        _say(f"{what}: {burst}, {taken_s:.1f} s, {used:.0%} of a core; calls a fleet: {said}")
        return last

    async def rest(self, meter: Meter) -> None:
        """All fleets are done; nothing happens."""
        await self._await_phase("Done")
        self._figures.done_s = time.perf_counter() - self._resumed_s
        _say(f"all done {self._figures.done_s:.1f} s after they were resumed")
        await asyncio.sleep(_QUIET_S)
        first = await meter.look()
        self._spent(first)
        self._rested = meter
        await asyncio.sleep(_REST_S)
        last = await meter.look()
        self._figures.rest_calls = sum(last.calls.values()) - sum(first.calls.values())
        self._figures.rest_cpu_s = last.cpu_s - first.cpu_s
        self._figures.rest_rss_mib, self._figures.rest_pss_mib = last.rss_mib, meter.pss_mib
        _say(f"at rest: {self._figures.rest_calls:.0f} calls a minute, {last.rss_mib:.0f} MiB")

    async def _floor(self, made: Callable[[int], list[Manifest]]) -> float:
        """Objects a second of a client that only sends; what it applied is removed."""
        manifests = [each for index in range(min(self._fleets, _FLOOR_FLEETS)) for each in made(index)]
        taken_s = await self._client.apply_all(manifests)
        services = [each for each in manifests if kind_of(each) == SERVICE]  # which cannot be deleted together
        paths = [SERVICE.path(FLOOR, each["metadata"]["name"]) for each in services]
        await self._client.for_each(paths, lambda path: self._client.call("DELETE", path))
        for kind in {kind_of(each) for each in manifests} - {SERVICE}:
            await self._client.call("DELETE", f"{kind.path(FLOOR)}?propagationPolicy=Background")
        _say(f"floor: {len(manifests)} objects in {taken_s:.1f} s, {len(manifests) / taken_s:.0f}/s")
        return len(manifests) / taken_s

    async def _floor_after(self, what: str, made: Callable[[int], list[Manifest]]) -> None:
        """The floor again; its mean of before and after counts, as other work on this computer comes and goes."""
        burst = self._figures.bursts[what]
        self._figures.bursts[what] = replace(burst, floor=(burst.floor + await self._floor(made)) / 2)

    async def _has_jobs(self, count: int) -> bool:
        listed = await self._client.call("GET", f"{JOB.path(NAMESPACE)}?limit=1")
        return len(listed["items"]) + int(listed["metadata"].get("remainingItemCount", 0)) >= count

    async def _all_over(self) -> bool:
        asked = f"{JOB.path(NAMESPACE)}?limit=1&fieldSelector=status.successful%3D0"
        return not (await self._client.call("GET", asked))["items"]

    async def _await_phase(self, phase: str) -> None:
        async def look() -> bool:
            listed = await self._client.call("GET", FLEET_SPEC.path(NAMESPACE))
            phases = Counter(each.get("status", {}).get("phase", "") for each in listed["items"])
            _say(str(dict(phases)), passing=True)
            return phases == {phase: self._fleets}

        await self._wait(f"phase {phase}", look)

    async def _wait(self, what: str, look: Callable[[], Awaitable[bool]], every_s: float = 2.0) -> None:
        end_s = time.perf_counter() + _PATIENCE_S
        while not await look():
            if time.perf_counter() > end_s:
                raise TimeoutError(f"{what}: not within {_PATIENCE_S:.0f} s")
            await asyncio.sleep(every_s)


def _say(text: str, passing: bool = False) -> None:
    """Progress, for who waits; what is passing only where it can be overwritten."""
    if not passing or os.environ.get("FLEET_BENCH_VERBOSE"):
        print(f"  {time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)

"""The operator at work: watches feed the queue, the lease lets it run, and everything ends in good order."""

from __future__ import annotations

import asyncio
import logging
import random
import time
from collections.abc import Coroutine, Iterator, Mapping, Sequence
from typing import Any, Protocol

from fleet.errors import ExitCode, FleetError, SpecError, StorageError
from fleet.storage.limits import within
from fleet_operator.cluster.connection import Connection
from fleet_operator.cluster.kubernetes_cluster import KubernetesCluster
from fleet_operator.cluster.memory import Listeners
from fleet_operator.config import Config
from fleet_operator.resources.refs import Manifest, ObjectRef
from fleet_operator.service import metrics
from fleet_operator.service.agenda import Agenda, Pauses
from fleet_operator.service.health import HealthServer
from fleet_operator.service.lease import Lease, Timing
from fleet_operator.service.metrics import Metrics
from fleet_operator.service.queue import WorkQueue

log = logging.getLogger(__name__)

LONGEST_PASS_S = 900.0
"""A pass that is at work for longer hangs; copying the contexts of a large fleet takes minutes."""
PASS_STORAGE_S = 600.0
"""What one pass may wait for storages altogether: they may be somebody's who answers as slowly as he can."""
SWEEP_S = 3600.0
SWEEP_AGAIN_S = (1.0, 300.0)
"""Between two sweeps, and after one that failed: the first time and the longest."""


class Reconciler(Protocol):
    """What the operator does for a fleet. Each method may be broken off anywhere, and is called again."""

    async def reconcile(self, ref: ObjectRef) -> float | None:
        """Bring a fleet one step further; seconds after which to look again, or None for only when it changes."""

    async def forget(self, ref: ObjectRef, last: Manifest | None) -> None:
        """A FleetSpec is gone; `last` is what it was."""

    async def sweep(self, alive: Mapping[ObjectRef, str]) -> None:
        """Clean up after FleetSpecs that went while no operator was there.

        Args:
            alive: Uid by FleetSpec, as it is at the moment of each look.
        """


class Service:
    """One operator process.

    Args:
        connection: To the cluster; its transport is entered.
        reconciler: Does the work.
    """

    def __init__(self, connection: Connection, reconciler: Reconciler, config: Config, numbers: Metrics) -> None:
        self._connection = connection
        self._reconciler = reconciler
        self._config = config
        self._numbers = numbers
        # All times of a lease follow from the one that others see.
        part_s = config.lease_s / 15.0
        timing = Timing(config.lease_s, 10.0 * part_s, 4.0 * part_s, 2.0 * part_s)
        self._lease = Lease(connection.leases, config.identity, timing)
        self._queue: WorkQueue[ObjectRef] = WorkQueue(
            Agenda(Pauses(), random.Random()), self._pass, self._failed, config.workers
        )
        self._gone: dict[ObjectRef, list[Manifest]] = {}
        self._leading = False

    async def run(self, stop: asyncio.Event, feeds: Sequence[Coroutine[Any, Any, None]] = ()) -> ExitCode:
        """Work until `stop` is set (OK), or the lease is lost (TRANSIENT).

        Args:
            feeds: Other watches that are to run as long.
        Raises:
            Exception: a watch ended in a way that it never should.
        """
        self._connection.memory.listeners = Listeners(self._changed, self._forgotten)
        self._connection.transport.left_s = lambda: self._lease.left_s
        self._numbers.watch(self._gauges())
        pages = {"/healthz": self._alive, "/readyz": self._ready, "/metrics": lambda: (200, self._numbers.text())}
        async with HealthServer(self._config.health_port, pages):
            stopping = asyncio.create_task(stop.wait(), name="stop")
            running = [self._connection.watches.run(), self._lead(), *feeds]
            tasks = [stopping, *(asyncio.create_task(each) for each in running)]
            try:
                done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
                for task in done:
                    task.result()
                return ExitCode.OK if stopping in done else ExitCode.TRANSIENT
            finally:
                await self._end()
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)

    async def _lead(self) -> None:
        """Take the lease and work; returns when it is lost."""
        await self._connection.watches.synced()
        log.info("%d fleets; waiting for the lease %s", len(self._cluster.fleets()), self._config.lease)
        await self._lease.acquire()
        log.info("this replica, %s, is at work", self._config.identity)
        async with asyncio.TaskGroup() as tasks:
            working = tasks.create_task(self._work(), name="working")
            await self._lease.keep()
            working.cancel()
        log.error("the lease is lost: another replica may be at work")

    async def _work(self) -> None:
        await self._connection.watches.refresh_fleets()
        self._leading = True
        for ref in self._cluster.fleets():
            self._queue.add(ref)
        async with asyncio.TaskGroup() as tasks:
            sweeping = tasks.create_task(self._sweep(), name="sweeping")
            await self._queue.run()
            sweeping.cancel()

    async def _sweep(self) -> None:
        """Clean up after fleets that are gone, now and every hour: nobody waits for that."""
        again_s, longest_s = SWEEP_AGAIN_S
        while True:
            try:
                with within(PASS_STORAGE_S):
                    await self._reconciler.sweep(Alive(self._cluster))
                pause_s, again_s = SWEEP_S, SWEEP_AGAIN_S[0]
            except FleetError as error:
                log.warning("what vanished fleets left behind was not cleaned up: %s", error)
                pause_s, again_s = again_s, min(2 * again_s, longest_s)
            except Exception:  # a fault of the program, which is no reason to leave those alone that are there
                log.exception("what vanished fleets left behind was not cleaned up")
                pause_s, again_s = again_s, min(2 * again_s, longest_s)
            await asyncio.sleep(pause_s)

    async def _end(self) -> None:
        """Let passes end, then let another replica work."""
        self._leading = False
        held = self._lease.held
        if await self._queue.close(self._config.stop_s if held else 0.0):
            await self._lease.release()
        else:
            log.warning("passes were broken off; the lease is not given back, as their calls may still arrive")

    async def _pass(self, ref: ObjectRef) -> float | None:
        started_s = time.monotonic()
        try:
            with within(PASS_STORAGE_S):
                await self._forget(ref)
                if self._cluster.fleet(ref) is None:
                    self._queue.discard(ref)
                    again_s = None
                else:
                    again_s = await self._reconciler.reconcile(ref)
        finally:
            self._numbers.count(metrics.PASS_SECONDS, time.monotonic() - started_s)
        self._numbers.count(metrics.PASSES, result="ok")
        return again_s

    async def _forget(self, ref: ObjectRef) -> None:
        """See to the data of FleetSpecs of this name that are gone.

        One that was made again is looked at all the same: its own pass says what is in its way, and the claim that is
        left is the sweep's.
        """
        while self._gone.get(ref):
            last = self._gone[ref][0]
            try:
                await self._reconciler.forget(ref, last)
            except (StorageError, SpecError) as error:
                if self._cluster.fleet(ref) is None:
                    raise
                log.warning("%s: what an earlier one of this name left behind was not cleaned up: %s", ref, error)
            self._gone[ref].remove(last)
        self._gone.pop(ref, None)

    def _failed(self, ref: ObjectRef, error: Exception, pause_s: float) -> None:
        self._numbers.count(metrics.PASSES, result="error")
        # An error of our own tree says all in its message; any other is a fault of the program.
        trace = None if isinstance(error, FleetError) else error
        log.warning("%s: %s; next try in %.1f s", ref, error or type(error).__name__, pause_s, exc_info=trace)

    def _changed(self, ref: ObjectRef) -> None:
        if self._leading:
            self._queue.add(ref)

    def _forgotten(self, ref: ObjectRef, last: Manifest) -> None:
        self._cluster.forget_owner(last["metadata"].get("uid", ""))
        if self._leading:
            self._gone.setdefault(ref, []).append(last)

    def _alive(self) -> tuple[int, str]:
        """Liveness: nothing hangs. That the API server is away is no reason to be started again."""
        stalled = self._connection.watches.stalled()
        if stalled:
            return 503, f"the watch of {stalled} hangs\n"
        if self._queue.longest_s > LONGEST_PASS_S:
            return 503, f"a pass over a fleet has been at work for {self._queue.longest_s:.0f} s\n"
        return 200, "ok\n"

    def _ready(self) -> tuple[int, str]:
        """Readiness: at work, or able to take over."""
        if not self._connection.watches.is_synced:
            return 503, "the watches have not seen everything yet\n"
        if not self._lease.is_heard:
            return 503, "the API server has not said for a while who holds the lease\n"
        return 200, "at work\n" if self._leading and self._lease.held else "ready to take over\n"

    def _gauges(self) -> dict[metrics.Metric, metrics.Gauge]:
        return {
            metrics.DUE: lambda: self._queue.depth,
            metrics.RUNNING: lambda: self._queue.running,
            metrics.FLEETS: lambda: len(self._cluster.fleets()),
            metrics.LEADING: lambda: float(self._leading and self._lease.held),
        }

    @property
    def _cluster(self) -> KubernetesCluster:
        return self._connection.cluster


class Alive(Mapping[ObjectRef, str]):
    """Uids of the FleetSpecs, always as they are now."""

    def __init__(self, cluster: KubernetesCluster) -> None:
        self._cluster = cluster

    def __getitem__(self, ref: ObjectRef) -> str:
        body = self._cluster.fleet(ref)
        if body is None:
            raise KeyError(ref)
        return str(body["metadata"].get("uid", ""))

    def __iter__(self) -> Iterator[ObjectRef]:
        return iter(self._cluster.fleets())

    def __len__(self) -> int:
        return len(self._cluster.fleets())

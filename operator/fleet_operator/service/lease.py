"""Which of several replicas is at work: the one that holds a Lease and renews it.

Source: kubernetes/client-go, tools/leaderelection: clocks of machines are not compared; a lease is over when its holder
has not renewed it for its whole duration on the observer's own clock.
"""

from __future__ import annotations

import asyncio
import logging
import random
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

from fleet_operator.cluster.errors import ClusterError, Conflict
from fleet_operator.cluster.leases import LeaseRecord

log = logging.getLogger(__name__)


class Leases(Protocol):
    """Where the Lease is; see cluster.leases."""

    async def read(self) -> LeaseRecord:
        """The Lease; an empty record when there is none."""

    async def write(self, record: LeaseRecord) -> LeaseRecord:
        """Write it as renewed now; a Conflict when it is of another version by now."""


@dataclass(frozen=True)
class Timing:
    """Times of a lease.

    Args:
        duration_s: For how long others leave a lease alone that is not renewed.
        deadline_s: For how long the holder counts on it without having renewed it; less than the duration.
        renew_s: Between two renewals.
        retry_s: Between two looks of one who waits for it.
    """

    duration_s: float = 15.0
    deadline_s: float = 10.0
    renew_s: float = 4.0
    retry_s: float = 2.0


class Lease:
    """One replica's part in it.

    Args:
        identity: Its name; one that starts again under the same name goes on with its own lease.
        now: Seconds on a clock that only goes forward.
    """

    def __init__(
        self,
        leases: Leases,
        identity: str,
        timing: Timing | None = None,
        chance: random.Random | None = None,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._leases = leases
        self._identity = identity
        self._timing = timing or Timing()
        self._chance = chance or random.Random()
        self._now = now
        self._record = LeaseRecord()
        self._seen_s = 0.0
        self._renewed_s: float | None = None
        self._heard_s: float | None = None

    @property
    def held(self) -> bool:
        """Whether this replica may write: it holds the lease, and nobody else can think that it is over."""
        return self.left_s > 0.0

    @property
    def left_s(self) -> float:
        """For how many seconds from now it may write; what it sends is to have taken effect by then."""
        if self._renewed_s is None:
            return 0.0
        return max(0.0, self._renewed_s + self._timing.deadline_s - self._now())

    @property
    def is_heard(self) -> bool:
        """Whether the Lease was read or written a short while ago: this replica works, or is ready to take over."""
        return self._heard_s is not None and self._now() < self._heard_s + self._timing.duration_s

    async def acquire(self) -> None:
        """Wait until this replica holds the lease."""
        while not await self._take():
            await asyncio.sleep(self._timing.retry_s * self._chance.uniform(0.8, 1.2))

    async def keep(self) -> None:
        """Renew it; returns when it is lost, and as soon as this replica can no longer count on it.

        What is at work in threads ends with the process, before others may take the lease.
        """
        mine = True
        while mine and self.held:
            await asyncio.sleep(min(self.left_s, self._timing.renew_s * self._chance.uniform(0.8, 1.0)))
            if not self.held:
                break
            try:
                async with asyncio.timeout(self.left_s):
                    mine = await self._renew()
            except TimeoutError:
                log.warning("the lease was not renewed in time")
        self._renewed_s = None

    async def release(self) -> None:
        """Give it back, so that another replica need not wait until it is over."""
        if not self.held:
            return
        self._renewed_s = None
        try:
            # Read anew: a renewal may have been on its way.
            record = await self._leases.read()
            if record.holder == self._identity:
                await self._leases.write(replace(record, holder="", duration_s=1.0))
        except ClusterError as error:
            log.warning("the lease was not given back: %s", error)

    async def _take(self) -> bool:
        started_s = self._now()
        try:
            record = await self._leases.read()
            self._heard_s = started_s
            if record.version != self._record.version:
                self._record, self._seen_s = record, started_s
            if record.holder not in ("", self._identity) and started_s < self._seen_s + record.duration_s:
                return False
            changes = record.transitions + (record.holder not in ("", self._identity))
            acquired = record.acquired if record.holder == self._identity else ""
            mine = LeaseRecord(self._identity, self._timing.duration_s, changes, acquired, record.version)
            self._record = await self._leases.write(mine)
        except Conflict:
            return False
        except ClusterError as error:
            log.warning("the lease cannot be looked at: %s", error)
            return False
        self._renewed_s = started_s
        return True

    async def _renew(self) -> bool:
        """Try once; False when another holds it."""
        started_s = self._now()
        try:
            self._record = await self._leases.write(self._record)
        except Conflict:
            return await self._still_mine()
        except ClusterError as error:
            log.warning("the lease was not renewed: %s", error)
        else:
            self._renewed_s = self._heard_s = started_s
        return True

    async def _still_mine(self) -> bool:
        """Whether a Conflict was only about somebody's label or a lost answer."""
        try:
            self._record = await self._leases.read()
        except ClusterError:
            return True
        return self._record.holder == self._identity

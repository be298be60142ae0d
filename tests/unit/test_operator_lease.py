"""Which replica is at work."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Awaitable
from dataclasses import replace
from typing import TypeVar

import pytest

from fleet_operator.cluster.errors import Conflict, Unavailable
from fleet_operator.cluster.leases import LeaseRecord
from fleet_operator.service.lease import Lease, Timing

T = TypeVar("T")
TIMING = Timing(duration_s=15.0, deadline_s=10.0, renew_s=0.0, retry_s=0.0)


class OneLease:
    """A Lease in memory that refuses stale versions as the API server does, and may be out of reach."""

    def __init__(self) -> None:
        self.record = LeaseRecord()
        self.reachable = True
        self.writes = 0

    async def read(self) -> LeaseRecord:
        self._reach()
        return self.record

    async def write(self, record: LeaseRecord) -> LeaseRecord:
        self._reach()
        if record.version != self.record.version:
            raise Conflict("the object has been modified")
        self.writes += 1
        self.record = replace(record, version=str(self.writes))
        return self.record

    def _reach(self) -> None:
        if not self.reachable:
            raise Unavailable("connection refused")


class World:
    """Two replicas with one clock."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.place = OneLease()
        self.first = self.replica("first")
        self.second = self.replica("second")

    def replica(self, identity: str) -> Lease:
        return Lease(self.place, identity, TIMING, random.Random(0), lambda: self.now_s)

    def tries(self, lease: Lease) -> bool:
        """Whether a replica gets the lease at once."""

        async def attempt() -> bool:
            task = asyncio.create_task(lease.acquire())
            for _ in range(10):
                await asyncio.sleep(0)
            got = task.done()
            task.cancel()
            return got

        return asyncio.run(attempt())


def run(awaitable: Awaitable[T]) -> T:
    async def scenario() -> T:
        return await asyncio.wait_for(awaitable, 30.0)

    return asyncio.run(scenario())


@pytest.fixture
def world() -> World:
    return World()


def test_the_first_to_come_takes_a_lease_that_is_not_there(world: World) -> None:
    assert world.tries(world.first)
    assert world.first.held
    assert world.place.record == LeaseRecord("first", 15.0, 0, "", "1")


def test_another_waits_as_long_as_the_lease_is_renewed(world: World) -> None:
    assert world.tries(world.first)
    for _ in range(5):
        assert not world.tries(world.second)
        world.now_s += 10.0
        run(world.place.write(world.place.record))
    assert not world.tries(world.second)


def test_another_takes_it_when_it_has_not_changed_for_its_duration(world: World) -> None:
    assert world.tries(world.first)
    assert not world.tries(world.second)
    world.now_s += 14.9
    assert not world.tries(world.second)
    world.now_s += 0.2
    assert world.tries(world.second)
    assert (world.place.record.holder, world.place.record.transitions) == ("second", 1)


def test_the_holder_stops_counting_on_it_before_others_may_take_it(world: World) -> None:
    assert world.tries(world.first)
    world.now_s += 9.9
    assert world.first.held
    world.now_s += 0.2
    assert not world.first.held


def test_a_lease_given_back_is_taken_at_once(world: World) -> None:
    assert world.tries(world.first)
    run(world.first.release())
    assert not world.first.held
    assert world.tries(world.second)


def test_one_that_starts_again_under_its_name_goes_on_with_its_lease(world: World) -> None:
    assert world.tries(world.first)
    assert world.tries(world.replica("first"))
    assert world.place.record.transitions == 0


def test_keeping_ends_when_another_holds_it(world: World) -> None:
    assert world.tries(world.first)
    world.place.record = LeaseRecord("second", 15.0, 1, "", "99")
    run(world.first.keep())
    assert not world.first.held


def test_keeping_goes_on_when_somebody_only_touched_the_object(world: World) -> None:
    assert world.tries(world.first)
    world.place.record = replace(world.place.record, version="99")

    async def keep_a_while() -> None:
        task = asyncio.create_task(world.first.keep())
        while world.place.writes < 3:
            await asyncio.sleep(0)
        task.cancel()

    run(keep_a_while())
    assert world.first.held


def test_keeping_ends_when_the_api_server_is_away_for_too_long(world: World) -> None:
    assert world.tries(world.first)
    world.place.reachable = False

    async def keep() -> None:
        task = asyncio.create_task(world.first.keep())
        for _ in range(10):
            await asyncio.sleep(0)
        assert not task.done()
        world.now_s += 10.1
        await task

    run(keep())
    assert not world.first.held


def test_keeping_ends_when_it_is_over_even_while_the_api_server_is_asked(world: World) -> None:
    class Silent(OneLease):
        async def write(self, record: LeaseRecord) -> LeaseRecord:
            if self.writes:
                await asyncio.Event().wait()  # an answer that never comes
            return await super().write(record)

    timing = replace(TIMING, deadline_s=0.05)
    lease = Lease(Silent(), "first", timing, random.Random(0))
    run(lease.acquire())
    run(lease.keep())
    assert not lease.held


def test_keeping_does_not_sleep_longer_than_the_lease_is_held(world: World) -> None:
    lease = Lease(world.place, "first", replace(TIMING, deadline_s=0.05, renew_s=3600.0), random.Random(0))
    run(lease.acquire())
    run(lease.keep())
    assert (lease.held, world.place.writes) == (False, 1)


def test_what_is_left_of_the_lease_is_counted_from_before_it_was_renewed(world: World) -> None:
    assert world.first.left_s == 0.0
    assert world.tries(world.first)
    world.now_s += 4.0
    assert world.first.left_s == 6.0
    world.now_s += 7.0
    assert world.first.left_s == 0.0


def test_readiness_needs_news_of_the_lease(world: World) -> None:
    assert not world.second.is_heard
    assert world.tries(world.first)
    assert not world.tries(world.second)
    assert world.second.is_heard
    world.place.reachable = False
    world.now_s += 15.1
    assert not world.tries(world.second)
    assert not world.second.is_heard

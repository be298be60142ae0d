"""The agenda of passes, and the queue that works it off."""

from __future__ import annotations

import asyncio
import random
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from fleet_operator.service.agenda import Agenda, Pauses
from fleet_operator.service.queue import WorkQueue

KEYS = st.sampled_from("abcd")
PAUSES = Pauses(rest_s=0.5, first_s=1.0, longest_s=8.0)


class PassesOverKeys(RuleBasedStateMachine):
    """Any order of changes, passes, failures and time; a model knows of each key when it must have a pass at last."""

    @initialize(seed=st.integers(0, 9))
    def start(self, seed: int) -> None:
        self.agenda: Agenda[str] = Agenda(PAUSES, random.Random(seed))
        self.now_s = 0.0
        self.working: set[str] = set()
        self.latest_s: dict[str, float] = {}  # a pass of the key must be possible from then on
        self.changed: set[str] = set()  # while it was at work
        self.ended_s: dict[str, float] = {}

    @rule(key=KEYS)
    def change(self, key: str) -> None:
        self.agenda.add(key, self.now_s)
        if key in self.working:
            self.changed.add(key)
        else:
            soon_s = max(self.now_s, self.ended_s.get(key, -1.0) + PAUSES.rest_s)
            self.latest_s[key] = min(self.latest_s.get(key, soon_s), soon_s)

    @rule(seconds=st.floats(0.0, 5.0))
    def time_passes(self, seconds: float) -> None:
        self.now_s += seconds

    @rule()
    def take(self) -> None:
        key = self.agenda.take(self.now_s)
        due = {each for each, latest_s in self.latest_s.items() if latest_s <= self.now_s}
        if key is None:
            assert not due, "a change was lost"
            return
        assert key not in self.working, "two passes of one key at once"
        assert self.now_s >= self.ended_s.get(key, -1.0) + PAUSES.rest_s, "a key was not left to rest"
        assert key in self.latest_s, "a pass that nobody asked for"
        del self.latest_s[key]
        self.working.add(key)

    @precondition(lambda self: self.working)
    @rule(data=st.data(), again_s=st.none() | st.floats(0.0, 20.0))
    def done(self, data: st.DataObject, again_s: float | None) -> None:
        key = data.draw(st.sampled_from(sorted(self.working)))
        self.agenda.done(key, self.now_s, again_s)
        self._ended(key)
        if key in self.changed:
            again_s = 0.0
        if again_s is not None:
            self.latest_s[key] = self.now_s + max(again_s, PAUSES.rest_s)
        self.changed.discard(key)

    @precondition(lambda self: self.working)
    @rule(data=st.data())
    def fail(self, data: st.DataObject) -> None:
        key = data.draw(st.sampled_from(sorted(self.working)))
        pause_s = self.agenda.failed(key, self.now_s)
        assert PAUSES.rest_s <= pause_s <= PAUSES.longest_s
        self._ended(key)
        self.changed.discard(key)
        self.latest_s[key] = self.now_s + pause_s

    @invariant()
    def nothing_is_planned_later_than_it_must_be(self) -> None:
        if self.latest_s and not self.agenda.depth:
            planned_s = self.agenda.next_s()
            assert planned_s is not None
            assert planned_s <= min(self.latest_s.values())

    def _ended(self, key: str) -> None:
        self.working.remove(key)
        self.ended_s[key] = self.now_s


TestPassesOverKeys = PassesOverKeys.TestCase


@given(failures=st.integers(1, 200), seed=st.integers(0, 1000))
def test_pauses_after_failures_double_up_to_a_limit_with_full_jitter(failures: int, seed: int) -> None:
    agenda: Agenda[str] = Agenda(PAUSES, random.Random(seed))
    for _ in range(failures):
        agenda.add("a", 1000.0)
        assert agenda.take(1000.0) == "a"
        pause_s = agenda.failed("a", 0.0)
    assert PAUSES.rest_s <= pause_s <= min(8.0, 2.0 ** (failures - 1))


def test_success_ends_the_back_off() -> None:
    agenda: Agenda[str] = Agenda(PAUSES, random.Random(0))
    for _ in range(20):
        agenda.add("a", 100.0)
        agenda.take(100.0)
        agenda.failed("a", 0.0)
    agenda.add("a", 100.0)
    agenda.take(100.0)
    agenda.done("a", 0.0)
    agenda.add("a", 100.0)
    agenda.take(100.0)
    assert agenda.failed("a", 0.0) <= PAUSES.first_s


@given(st.lists(KEYS, min_size=1))
def test_keys_have_their_turn_in_the_order_of_their_changes(changes: list[str]) -> None:
    agenda: Agenda[str] = Agenda(PAUSES, random.Random(0))
    for key in changes:
        agenda.add(key, 0.0)
    taken = [agenda.take(0.0) for _ in range(len(set(changes)) + 1)]
    assert taken == [*dict.fromkeys(changes), None]


@given(
    changes=st.lists(st.tuples(KEYS, st.integers(0, 3)), min_size=1, max_size=40),
    workers=st.integers(1, 4),
    bad=st.sets(KEYS, max_size=2),
)
def test_every_change_is_seen_by_a_pass_that_begins_after_it(
    changes: list[tuple[str, int]], workers: int, bad: set[str]
) -> None:
    """Real tasks: passes read a number that changes raise; the last one each key sees must be its last number."""
    numbers: Counter[str] = Counter()
    seen: dict[str, int] = {}
    at_work: Counter[str] = Counter()
    failed_once: set[str] = set()

    async def work(key: str) -> float | None:
        at_work[key] += 1
        assert at_work[key] == 1
        assert at_work.total() <= workers
        number = numbers[key]
        await asyncio.sleep(0)
        at_work[key] -= 1
        if key in bad and key not in failed_once:
            failed_once.add(key)
            raise ValueError(key)
        seen[key] = number
        return None

    async def scenario() -> None:
        agenda: Agenda[str] = Agenda(Pauses(rest_s=0.0, first_s=0.001, longest_s=0.002), random.Random(0))
        queue = WorkQueue(agenda, work, lambda key, error, pause_s: None, workers)
        running = asyncio.create_task(queue.run())
        for key, turns in changes:
            numbers[key] += 1
            queue.add(key)
            for _ in range(turns):
                await asyncio.sleep(0)
        while seen != numbers:
            await asyncio.sleep(0.001)
        assert await queue.close(grace_s=10.0)
        await running

    asyncio.run(asyncio.wait_for(scenario(), 30.0))


@pytest.mark.parametrize("patient", [True, False])
def test_closing_waits_for_the_passes_at_work_and_breaks_off_those_that_do_not_end(patient: bool) -> None:
    events: list[str] = []

    async def work(key: str) -> float | None:
        try:
            await asyncio.sleep(0.01 if patient else 3600.0)
        except asyncio.CancelledError:
            events.append("broken off")
            raise
        events.append("ended")
        return None

    async def scenario() -> bool:
        agenda: Agenda[str] = Agenda(Pauses(), random.Random(0))
        queue = WorkQueue(agenda, work, lambda key, error, pause_s: None, workers=1)
        running = asyncio.create_task(queue.run())
        queue.add("a")
        queue.add("b")  # never begins: there is one worker, and the queue is closed first
        while not queue.running:
            await asyncio.sleep(0)
        ended = await queue.close(grace_s=30.0 if patient else 0.0)
        await running
        return ended

    assert asyncio.run(asyncio.wait_for(scenario(), 60.0)) is patient
    assert events == (["ended"] if patient else ["broken off"])

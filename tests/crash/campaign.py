"""Many runs side by side, each compared with the undisturbed one."""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass

from tests.crash.application import Story
from tests.crash.picture import differences
from tests.crash.trial import Kill, Plan, Result, run_trial
from tests.crash.world import World
from tests.testbed.errors import BedError
from tests.testbed.faults import Moment


@dataclass(frozen=True)
class Allowed:
    """What a fault may change.

    Args:
        events: Reasons of events that may be there beside those of the undisturbed run.
        lost_events: An event may be missing: the operator does not try for ever to post one.
        started_again: Jobs that may have more pods.
    """

    events: frozenset[str] = frozenset()
    lost_events: bool = False
    started_again: frozenset[str] = frozenset()


NOTHING = Allowed()


def all_kills(writes: Mapping[str, int]) -> list[Kill]:
    """Every write of a run, and both moments."""
    return [
        Kill(door, number, moment)
        for door, count in sorted(writes.items())
        for number in range(1, count + 1)
        for moment in Moment
    ]


def sample(kills: Sequence[Kill], size: int, seed: int) -> list[Kill]:
    """Some of the kills, from all parts of the run."""
    chance = random.Random(seed)
    step = len(kills) / size
    return [kills[int(step * (index + chance.random()))] for index in range(size)]


def problems(expected: Result, found: Result, allowed: Allowed = NOTHING) -> list[str]:
    """In words, what a run did not do as the undisturbed one."""
    lines: list[str] = []
    if expected.picture is not None and found.picture is not None:
        lines += differences(expected.picture, found.picture, allowed.events, lost_events=allowed.lost_events)
    for job in sorted({*expected.starts, *found.starts} if found.picture is not None else ()):
        before, after = expected.starts.get(job, 0), found.starts.get(job, 0)
        if before != after and not (job in allowed.started_again and after > before):
            lines.append(f"starts of {job}: {before} became {after}")
    return lines + [f"left behind: {each}" for each in found.left]


def carry_out(world: World, story: Story, expected: Result, kills: Iterable[Kill]) -> Iterator[tuple[Kill, list[str]]]:
    """Run all kills, as many side by side as the world has slots; what went wrong with each, as they end."""
    plans = [Plan(f"kill-{story.missions}-{index}", story, kill) for index, kill in enumerate(kills, start=1)]
    with ThreadPoolExecutor(world.slots.qsize()) as pool:
        runs = {pool.submit(check, world, expected, plan): plan.kill for plan in plans}
        for run in as_completed(runs):
            kill = runs[run]
            if kill is not None:
                yield kill, run.result()


def check(world: World, expected: Result, plan: Plan, allowed: Allowed = NOTHING) -> list[str]:
    """Run a plan; in words, what went wrong."""
    try:
        found = run_trial(world, plan)
    except (AssertionError, BedError) as error:
        return [str(error)]
    lines = problems(expected, found, allowed)
    # A run may have a write fewer than the undisturbed one; then there was nothing to kill at.
    if found.killed_at and found.starts_of_operator < 2:
        lines.append("the operator was killed and not started again")
    return [f"killed at: {found.killed_at}", *lines] if lines and plan.kill is not None else lines

"""Kill the operator before and after each of its writes, and bring faults about: `python -m tests.crash --all`."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from tests.crash.application import LONG, ROUGH, Story
from tests.crash.campaign import all_kills, carry_out, check, problems, sample
from tests.crash.scenarios import SCENARIOS, Scenario
from tests.crash.trial import Kill, Plan, run_trial
from tests.crash.world import World, side_by_side, world
from tests.testbed.faults import Moment

STORIES = {"long": LONG, "rough": ROUGH}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is asked for; 1 when something left a difference."""
    given = _arguments(arguments)
    failed = 0
    with tempfile.TemporaryDirectory(prefix="fleet-crash-") as folder, world(Path(folder), given.slots) as place:
        for name in given.story if given.faults is None or given.all else ():
            failed += kills(place, name, STORIES[name], given)
        if given.all or given.faults is not None:
            failed += faults(place, given.faults or ())
    return 1 if failed else 0


def kills(place: World, name: str, story: Story, given: argparse.Namespace) -> int:
    """Kill the operator in runs of one story; how many left a difference."""
    expected = run_trial(place, Plan(name, story))
    again = run_trial(place, Plan(f"{name}-again", story))
    say(f"{name}: {expected.writes['api']} writes to the API, {expected.writes['storage']} to storage")
    if unlike := problems(expected, again):
        tell(f"{name}: two undisturbed runs", unlike)
        return 1
    planned = chosen(given, expected.writes)
    started_s, failed = time.monotonic(), 0
    for number, (kill, lines) in enumerate(carry_out(place, story, expected, planned), start=1):
        failed += bool(lines)
        tell(f"{name}, {number}/{len(planned)}: {kill}", lines)
    say(f"{name}: {len(planned)} kills in {time.monotonic() - started_s:.0f} s, {failed} of them left a difference")
    return failed


def faults(place: World, wanted: Sequence[str]) -> int:
    """Run the scenarios of these names, or all; how many left a difference."""
    selected = [each for each in SCENARIOS if not wanted or each.name in wanted]
    stories = {each.story.fleet: each.story for each in selected}
    expected = {fleet: run_trial(place, Plan(f"{fleet}-undisturbed", story)) for fleet, story in stories.items()}

    def run(scenario: Scenario) -> list[str]:
        return check(place, expected[scenario.story.fleet], scenario.plan, scenario.allowed)

    failed = 0
    with ThreadPoolExecutor(place.slots.qsize()) as pool:
        runs = {pool.submit(run, each): each for each in selected if not each.alone}
        for each in as_completed(runs):
            failed += bool(each.result())
            tell(runs[each].name, each.result())
    for scenario in [each for each in selected if each.alone]:
        lines = run(scenario)
        failed += bool(lines)
        tell(scenario.name, lines)
    return failed


def chosen(given: argparse.Namespace, writes: Mapping[str, int]) -> list[Kill]:
    """The kills that the command line asks for."""
    if given.only:
        parts = [each.split(":") for each in given.only]
        return [Kill(door, int(number), Moment(moment)) for door, number, moment in parts]
    kills = all_kills(writes)
    return kills if given.all else sample(kills, min(given.sample, len(kills)), given.seed)


def tell(what: str, lines: Sequence[str]) -> None:
    """One run in a line, and what was wrong with it below."""
    say(f"{what}: {'as undisturbed' if not lines else 'DIFFERS'}")
    for line in lines:
        say(f"    {line}")


def say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def _arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.crash", description=__doc__)
    parser.add_argument("--all", action="store_true", help="every write, both moments, and all faults")
    parser.add_argument("--story", nargs="*", choices=STORIES, default=list(STORIES), help="what the runs go through")
    parser.add_argument("--sample", type=int, default=8, help="how many kills of a story, when not all (8)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample (0)")
    parser.add_argument("--only", nargs="*", metavar="DOOR:WRITE:MOMENT", help="these: api:17:after storage:3:before")
    parser.add_argument("--faults", nargs="*", metavar="NAME", help="the faults of tests/crash/scenarios.py instead")
    parser.add_argument("--slots", type=int, default=side_by_side(), help="runs side by side (4 or cores)")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())

"""What a fleet has reached, from the names of its objects in storage."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence

from fleet.storage.layout import FleetPaths
from fleet_operator.policy.lifecycle import MissionProgress


def is_trained(paths: FleetPaths, objects: Collection[str]) -> bool:
    """Whether the reward and the initial model are there."""
    return paths.reward in objects and paths.initial_model in objects


def missions_so_far(
    paths: FleetPaths,
    objects: Collection[str],
    agents: Sequence[str],
    due: Callable[[int], frozenset[str]],
    failed: Callable[[int], frozenset[str]] = lambda number: frozenset(),
) -> tuple[MissionProgress, ...]:
    """Progress of missions 1, 2, ... up to the last that was ordered.

    Args:
        objects: Paths of everything that is in storage under the fleet's root.
        due: Subsets whose aggregators are to run after a mission; asked for evaluated missions only.
        failed: Agents that failed in a mission; asked for evaluated missions only.
    """
    plan = re.compile(re.escape(paths.root) + r"/missions/(\d+)/plan\.json")
    ordered = {int(match[1]) for match in map(plan.fullmatch, objects) if match}
    return tuple(
        _mission(paths, objects, agents, number, (due, failed)) for number in range(1, max(ordered, default=0) + 1)
    )


def _mission(
    paths: FleetPaths,
    objects: Collection[str],
    agents: Sequence[str],
    number: int,
    asked: tuple[Callable[[int], frozenset[str]], Callable[[int], frozenset[str]]],
) -> MissionProgress:
    evaluated = paths.evaluation(number) in objects
    due, failed = (ask(number) if evaluated else frozenset[str]() for ask in asked)
    return MissionProgress(
        ordered=paths.plan(number) in objects,
        landed=frozenset(agent for agent in agents if paths.landing(number, agent) in objects),
        failed=failed,
        evaluated=evaluated,
        due=due,
        retrained=frozenset(subset for subset in due if paths.retraining(number, subset) in objects),
        weighed=paths.weights(number + 1) in objects,
    )

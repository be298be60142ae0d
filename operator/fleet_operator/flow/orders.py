"""What is decided before a mission and after it, from documents in storage: its order, and the aggregators' terms."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fleet.aggregation.latest import latest_models
from fleet.aggregation.subsets import subsets_for
from fleet.missions.documents import INITIAL, MissionEvaluation, MissionOrder, WeightsDocument
from fleet.spec.base import quantity_value
from fleet.spec.resources import Fleet
from fleet.storage.layout import FleetPaths
from fleet.storage.port import Storage
from fleet.usefulness.weights import first_weights, usefulness
from fleet_operator.compiler.target import AggregatorTerms
from fleet_operator.policy.level import UNSEEN_LEVEL, levels
from fleet_operator.policy.pruning import pruned
from fleet_operator.policy.shares import Capacity, shares, shares_of_the_rest
from fleet_operator.resources.roles import LOWEST_LEVEL
from fleet_operator.resources.views import NodeView


def write_order(storage: Storage, paths: FleetPaths, fleet: Fleet, number: int, subsets: Collection[str]) -> None:
    """Write a mission's plan; for the first mission its weights before. Doing it twice leaves the same objects.

    Args:
        subsets: Keys of the fleet's subsets.
    """
    if number == 1 and not storage.exists(paths.weights(1)):
        agents = [agent.name for agent in fleet.agents.resolved]
        weights = first_weights(agents)
        models = [INITIAL, *subsets]
        first = WeightsDocument(number=1, weights=weights, usefulness=usefulness(weights, models))
        storage.write(paths.weights(1), first.model_dump_json(by_alias=True, indent=1).encode())
    order = MissionOrder(
        number=number,
        context=fleet.state_space.context,
        seed=fleet.missions.seed,
        models=latest_models(storage, paths, number, subsets),
        weights=read_weights(storage, paths, number).weights,
    )
    storage.write(paths.plan(number), order.model_dump_json(by_alias=True, indent=1).encode())


def read_weights(storage: Storage, paths: FleetPaths, number: int) -> WeightsDocument:
    """Weights that a mission flies with. Raises ObjectNotFound when they are not there yet."""
    return WeightsDocument.model_validate_json(storage.read(paths.weights(number)))


def read_evaluation(storage: Storage, paths: FleetPaths, number: int) -> MissionEvaluation:
    """Evaluation of a mission. Raises ObjectNotFound when it is not over."""
    return MissionEvaluation.model_validate_json(storage.read(paths.evaluation(number)))


@dataclass(frozen=True)
class Room:
    """What there is for aggregators.

    Args:
        total: Of all machines together.
        largest: Of the largest machine.
    """

    total: Capacity
    largest: Capacity

    @staticmethod
    def of_one(machine: Capacity) -> Room:
        """The room of a single machine."""
        return Room(machine, machine)

    @staticmethod
    def of(nodes: Iterable[NodeView]) -> Room:
        """The room of a cluster: that of all machines that are ready and take pods."""
        able = [Capacity(node.cores, node.memory_bytes) for node in nodes if node.ready and node.schedulable]
        return Room(
            Capacity(sum(each.cores for each in able), sum(each.memory_bytes for each in able)),
            Capacity(
                max((each.cores for each in able), default=0.0), max((each.memory_bytes for each in able), default=0.0)
            ),
        )


def aggregator_terms(
    fleet: Fleet, history: Mapping[int, WeightsDocument], number: int, room: Room, keys: Sequence[str]
) -> tuple[AggregatorTerms, ...]:
    """Level and share of each aggregator after a mission; one that is pruned or of level 0 is suspended.

    Args:
        history: The weights of missions 1..number; without pruning, only those of `number` count.
        room: What all aggregators share, unless the FleetSpec says it.
        keys: Keys of the fleet's subsets.
    """
    known = history[number].usefulness
    gone = pruned([history[each].usefulness for each in sorted(history) if each <= number], fleet.aggregation.pruning)
    by_model = levels({**dict.fromkeys(keys), **known}, fleet.usefulness_scale)
    chosen = {key: 0 if key in gone else by_model[key] for key in keys}
    divided = shares(chosen, total_for(fleet, room), room.largest)
    return tuple(AggregatorTerms(key, chosen[key], divided.get(key)) for key in keys)


def in_waves(terms: Iterable[AggregatorTerms]) -> tuple[tuple[AggregatorTerms, ...], ...]:
    """Aggregators in the order in which their Jobs are made: those that are suspended, then level by level.

    The scheduler places what it is given first, and ends it again for what comes later and has a higher priority: that
    costs the higher one time, and the lower one all that it has done.
    """
    by_level: dict[int, list[AggregatorTerms]] = {}
    for each in terms:
        by_level.setdefault(each.level, []).append(each)
    order = sorted(by_level, key=lambda level: (level > LOWEST_LEVEL, -level))
    return tuple(tuple(by_level[level]) for level in order)


def terms_of_the_rest(
    fleet: Fleet, terms: Sequence[AggregatorTerms], absent: Collection[str], room: Room
) -> tuple[AggregatorTerms, ...]:
    """Terms of the aggregators that are at work, when these divide among them what there is.

    Args:
        absent: Subsets whose aggregators use nothing: they are over, or no machine has room for them yet.
    """
    by_subset = {each.subset: each.level for each in terms}
    divided = shares_of_the_rest(by_subset, absent, total_for(fleet, room), room.largest)
    return tuple(replace(each, share=divided[each.subset]) for each in terms if each.subset in divided)


def total_for(fleet: Fleet, room: Room) -> Capacity:
    """What all aggregators share: the FleetSpec's amounts, else all that there is."""
    scheduling = fleet.scheduling
    return Capacity(
        room.total.cores if scheduling.cpu is None else quantity_value(scheduling.cpu),
        room.total.memory_bytes if scheduling.memory is None else quantity_value(scheduling.memory),
    )


def neutral_terms(fleet: Fleet, folder: Path) -> tuple[AggregatorTerms, ...]:
    """Terms before anything is known of any model: the level of what was never evaluated, no shares.

    Args:
        folder: Where the FleetSpec is, with the user's own aggregation beside it.
    """
    sys.path.insert(0, str(folder.absolute()))
    try:
        return tuple(AggregatorTerms(subset.key, UNSEEN_LEVEL) for subset in subsets_for(fleet))
    finally:
        sys.path.remove(str(folder.absolute()))

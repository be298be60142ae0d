"""Level and share of aggregators after a mission, from documents."""

from __future__ import annotations

from typing import Any

from fleet.missions.documents import WeightsDocument
from fleet.spec.resources import Fleet
from fleet_operator.compiler.target import AggregatorTerms
from fleet_operator.flow.orders import Room, aggregator_terms, in_waves, terms_of_the_rest
from fleet_operator.policy.shares import Capacity
from tests.fleet_runs import spec_document

MACHINE = Room.of_one(Capacity(4.0, 8 * 2**30))
KEYS = ("1", "2", "1-2")


def fleet(**changes: Any) -> Fleet:
    return Fleet.model_validate(spec_document(**changes)["spec"])


FIRST = {1: WeightsDocument(number=1, weights={}, usefulness={})}


def test_models_that_have_not_flown_are_level_1_and_share_alike() -> None:
    terms = aggregator_terms(fleet(), FIRST, 1, MACHINE, KEYS)
    assert [(each.subset, each.level) for each in terms] == [("1", 1), ("2", 1), ("1-2", 1)]
    assert {round(each.share.limit.cores, 9) for each in terms if each.share} == {round(4 / 3, 9)}


def test_useful_models_get_more_and_useless_ones_are_suspended() -> None:
    document = WeightsDocument(number=2, weights={}, usefulness={"initial": 0.0, "1": 0.75, "2": 0.25, "1-2": 0.0})
    terms = {each.subset: each for each in aggregator_terms(fleet(), {2: document}, 2, MACHINE, KEYS)}
    assert {key: each.level for key, each in terms.items()} == {"1": 8, "2": 3, "1-2": 0}
    assert terms["1-2"].share is None
    assert terms["1"].share is not None
    assert terms["1"].share.limit.cores == 4 * 8 / 11


def test_pruned_models_are_suspended() -> None:
    pruning = {"pruning": {"below": 0.3, "after": 2}}
    history = {
        number: WeightsDocument(number=number, weights={}, usefulness={"1": 0.8, "2": 0.2, "1-2": None})
        for number in (2, 3)
    }
    terms = aggregator_terms(fleet(aggregation=pruning), history, 3, MACHINE, KEYS)
    assert {each.subset: each.level for each in terms} == {"1": 8, "2": 0, "1-2": 1}


def test_no_aggregator_gets_more_than_the_largest_machine_has() -> None:
    room = Room(Capacity(8.0, 8 * 2**30), Capacity(2.0, 2**30))
    limits = [each.share.limit for each in aggregator_terms(fleet(), FIRST, 1, room, KEYS) if each.share]
    assert limits == [Capacity(2.0, 2**30)] * 3


def test_the_fleetspec_bounds_what_aggregators_share() -> None:
    terms = aggregator_terms(fleet(scheduling={"cpu": "600m", "memory": "3Gi"}), FIRST, 1, MACHINE, KEYS)
    limits = [each.share.limit for each in terms if each.share]
    assert [round(limit.cores, 9) for limit in limits] == [0.2] * 3
    assert [limit.memory_bytes for limit in limits] == [2**30] * 3


def test_jobs_are_made_in_the_order_of_their_levels_after_those_that_are_suspended() -> None:
    terms = [AggregatorTerms(key, level) for key, level in (("1", 2), ("2", 0), ("3", 9), ("1-2", 2), ("1-3", 5))]
    waves = [[each.subset for each in wave] for wave in in_waves(terms)]
    assert waves == [["2"], ["3"], ["1-3"], ["1", "1-2"]]
    assert in_waves([]) == ()


def test_those_at_work_divide_what_the_others_do_not_use() -> None:
    usefulness = {"1": 0.6, "2": 0.2, "1-2": 0.3}
    document = WeightsDocument(number=1, weights={}, usefulness=dict(usefulness))
    terms = aggregator_terms(fleet(), {1: document}, 1, MACHINE, KEYS)
    rest = terms_of_the_rest(fleet(), terms, {"1-2"}, MACHINE)
    assert [(each.subset, each.level, each.share and each.share.limit.cores) for each in rest] == [
        ("1", 6, 3.0),
        ("2", 2, 1.0),
    ]

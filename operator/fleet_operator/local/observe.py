"""What a run has reached, and how far its phase is, both read from storage."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from fleet.aggregation.subsets import subsets_for
from fleet.errors import ObjectNotFound
from fleet.missions.documents import WeightsDocument
from fleet.missions.records import read_log
from fleet.storage.layout import FleetPaths
from fleet.storage.port import Storage
from fleet_operator.compiler.target import AggregatorTerms
from fleet_operator.flow.orders import Room, aggregator_terms, read_weights
from fleet_operator.flow.records import read_records
from fleet_operator.local.application import Application
from fleet_operator.local.display import Gauge
from fleet_operator.policy.lifecycle import Progress
from fleet_operator.policy.shares import Capacity

_FRACTION = re.compile(r"(\d+)\s*(?:/|of)\s*(\d+)")


class Observer:
    """Reads what is there of a run.

    Args:
        application: Whose run.
        capacity: What the machine has for aggregators.
    """

    def __init__(self, application: Application, capacity: Capacity) -> None:
        self._application = application
        self._capacity = capacity
        self._storage: Storage = application.storage
        self._paths: FleetPaths = application.paths

    def progress(self, given_up: Mapping[int, Collection[str]], broken: str) -> Progress:
        """What the run has reached.

        Args:
            given_up: Subsets whose aggregators have failed for good, by mission.
            broken: Why the run cannot go on; "" when it can.
        """

        def due(number: int) -> frozenset[str]:
            return frozenset(each.subset for each in self.terms(number) if each.level > 0)

        reached = read_records(self._storage, self._paths).progress(self._application.fleet, due, broken)
        return replace(reached, given_up=frozenset(given_up.get(len(reached.missions), ())))

    def terms(self, number: int) -> tuple[AggregatorTerms, ...]:
        """Level and share of each aggregator after a mission."""
        fleet = self._application.fleet
        keys = [subset.key for subset in subsets_for(fleet)]
        return aggregator_terms(fleet, self.history(number), number, Room.of_one(self._capacity), keys)

    def history(self, number: int) -> dict[int, WeightsDocument]:
        """The weights of missions 1..number, as far as they are there."""
        found = {}
        for mission in range(1, number + 1):
            try:
                found[mission] = read_weights(self._storage, self._paths, mission)
            except ObjectNotFound:
                continue
        return found

    def flight_gauges(self, number: int, agents: Sequence[str]) -> list[Gauge]:
        """States visited by each agent."""
        return [self._flight_gauge(number, agent) for agent in agents]

    def retraining_gauges(self, number: int, subsets: Sequence[str]) -> list[Gauge]:
        """Aggregators that have reported."""
        done = sum(self._storage.exists(self._paths.retraining(number, subset)) for subset in subsets)
        return [Gauge("aggregators", done, len(subsets))]

    def _flight_gauge(self, number: int, agent: str) -> Gauge:
        try:
            records = read_log(self._storage.read(self._paths.log(number, agent)))
        except ObjectNotFound:
            records = ()
        captured = sum(record.captured for record in records)
        over = self._storage.exists(self._paths.landing(number, agent))
        text = f"{len(records)} states, {captured} captured{', landed' if over else ''}"
        return Gauge(agent, len(records), len(records) if over else None, text)


def trainer_gauges(log: Path) -> list[Gauge]:
    """How far a trainer is, by the last line of its log."""
    try:
        lines = log.read_text(errors="replace").splitlines()
    except OSError:
        lines = []
    line = re.sub(r"^[-\d]+ [\d:,]+ [A-Z]+ ", "", lines[-1]) if lines else ""
    found = _FRACTION.search(line)
    if found is None or int(found[2]) < int(found[1]):
        return [Gauge("trainer", text=line[:70])]
    return [Gauge("trainer", int(found[1]), int(found[2]), line[:70])]

"""The fleets of the benchmark: FleetSpecs, the files beside them, and the objects that are made of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fleet.aggregation.subsets import subsets_for
from fleet.spec.load import parse_fleet_spec
from fleet_operator.compiler.bundle import Bundle
from fleet_operator.compiler.missions import aggregator_job, mission_manifest, sensor_job, sensor_service, workflow_job
from fleet_operator.compiler.settings import Settings
from fleet_operator.compiler.target import AggregatorTerms, Owner, Target
from fleet_operator.flow.sources import read_bundle
from fleet_operator.policy.level import UNSEEN_LEVEL
from fleet_operator.policy.shares import Capacity, Share
from fleet_operator.resources.applied import applied_hash, marked
from tests.fleet_runs import spec_document, write_application

Manifest = dict[str, Any]
NAMESPACE, FLOOR = "fleets", "floor"
AGENTS = 4
NO_UID = "00000000-0000-0000-0000-000000000000"


def name(index: int) -> str:
    """Name of a fleet."""
    return f"fleet-{index:04d}"


def fleet_spec(index: int, namespace: str = NAMESPACE, missions: int = 1, suspend: bool = True) -> Manifest:
    """A FleetSpec as its user applies it; it waits after training until it is resumed."""
    document = spec_document(
        agents={"count": AGENTS},
        stateSpace={"context": "field", "groups": {"rows": 1, "columns": AGENTS}},
        missions={"count": missions},
        suspend=suspend,
    )
    document["metadata"] = {"name": name(index), "namespace": namespace}
    return document


def write_library(folder: Path, fleets: int) -> None:
    """The files of all fleets, which are the same."""
    write_application(folder / "application")
    for index in range(fleets):
        (folder / name(index)).symlink_to("application")


class Objects:
    """What the operator makes of the fleets, made without an operator, for another namespace.

    Args:
        library: Of `write_library`.
        storage: Its address.
    """

    def __init__(self, library: Path, storage: str, settings: Settings) -> None:
        self._settings = settings
        self._storage = storage
        self._bundle: Bundle = read_bundle(parse_fleet_spec(fleet_spec(0)).spec, library / "application")

    def target(self, index: int, namespace: str, uid: str) -> Target:
        spec = parse_fleet_spec(fleet_spec(index, namespace))
        owner = Owner(spec.api_version, "FleetSpec", spec.name, uid)
        return Target(spec, self._bundle, self._settings, self._storage, owner)

    def flight(self, index: int, namespace: str = FLOOR, uid: str = NO_UID) -> list[Manifest]:
        """Mission, Services, sensors and workflows."""
        target = self.target(index, namespace, uid)
        agents = [agent.name for agent in target.fleet.agents.resolved]
        made = [mission_manifest(target, 1)]
        for build in (sensor_service, sensor_job, workflow_job):
            made += [build(target, 1, agent) for agent in agents]
        return [marked(each, applied_hash(each)) for each in made]

    def retraining(self, index: int, namespace: str = FLOOR, uid: str = NO_UID) -> list[Manifest]:
        """The aggregators of all subsets, with shares like those that the operator gives."""
        target = self.target(index, namespace, uid)
        keys = [subset.key for subset in subsets_for(target.fleet)]
        share = Share(Capacity(1.0, 2.0**30), Capacity(8.0, 16.0 * 2**30))
        made = [aggregator_job(target, 1, AggregatorTerms(key, UNSEEN_LEVEL, share)) for key in keys]
        return [marked(each, applied_hash(each)) for each in made]

"""What a pass writes to storage: the FleetSpec with its contexts, orders, and landings of agents that cannot land."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from fleet.energy.accounting import EnergyModel
from fleet.energy.model import energy_model
from fleet.errors import MissionError
from fleet.spec.resources import FleetSpec
from fleet.storage.port import Storage
from fleet_operator.compiler.bundle import Bundle
from fleet_operator.flow.contexts import copy_contexts
from fleet_operator.flow.files import place
from fleet_operator.flow.landings import write_failed_landing
from fleet_operator.flow.orders import write_order
from fleet_operator.flow.stored import Flown, write_flown
from fleet_operator.reconcile.asked import Shelf
from fleet_operator.reconcile.observe import Observed


def prepare(observed: Observed, shelf: Shelf, opened: Callable[[str], Storage]) -> FleetSpec:
    """Put contexts, functions and FleetSpec into storage, the FleetSpec last.

    Args:
        opened: Opens the storage of a context that has an address.

    Returns:
        The FleetSpec as it is in storage now.

    Raises:
        ContextError: a context is not there, or is not a good one.
        SpecError: the files beside the FleetSpec are damaged.
        StorageError: the storage refuses.
    """
    flown, storage, paths = _asked(observed), observed.storage, observed.paths
    with shelf.folder(flown.spec.name) as folder:
        copy_contexts(flown.spec, folder, storage, paths, opened)
    if not observed.is_current and paths.reward in observed.records.objects and _only_shaped(observed):
        storage.delete(paths.reward)  # of another FleetSpec, perhaps; the trainer's checkpoints know
    return write_flown(storage, paths, flown, observed.stored)


def order(observed: Observed, number: int) -> None:
    """Write a mission's plan. Raises StorageError."""
    if observed.subsets is None:
        raise MissionError("the subsets of the user's own aggregation are not known")
    _clear(observed, number)
    keys = [subset.key for subset in observed.subsets]
    write_order(observed.storage, observed.paths, _asked(observed).fleet, number, keys)


def _clear(observed: Observed, number: int) -> None:
    """Remove what is left of a flight that is flown again; its weights are the work of the mission before."""
    folder, weights = observed.paths.mission(number), observed.paths.weights(number)
    left = {
        path[len(folder) + 1 :].partition("/")[0] for path in observed.records.objects if path.startswith(f"{folder}/")
    }
    for part in sorted(left):
        if f"{folder}/{part}" != weights:
            observed.storage.delete(f"{folder}/{part}")


def land(observed: Observed, number: int, agent: str, reason: str) -> None:
    """Write the landing of an agent that failed. Raises StorageError."""
    if observed.flown is None:
        raise MissionError(f"{agent} flies nothing")
    energy = _energy(observed.flown)
    write_failed_landing(observed.storage, observed.paths, number, agent, reason, energy)


def _asked(observed: Observed) -> Flown:
    if observed.asked.flown is None:
        raise MissionError("a FleetSpec that is refused is not prepared")
    return observed.asked.flown


def _only_shaped(observed: Observed) -> bool:
    return observed.paths.initial_model not in observed.records.objects


def _energy(flown: Flown) -> EnergyModel:
    """Profiles may be files beside the FleetSpec."""
    bundle: Bundle = flown.bundle
    with tempfile.TemporaryDirectory(prefix="fleet-profiles-") as name:
        place(bundle.files, Path(name))
        return energy_model(flown.fleet, Path(name))

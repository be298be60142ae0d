"""Which models a mission flies with: the initial one, and the latest of each subset that was retrained before."""

from __future__ import annotations

from collections.abc import Iterable

from fleet.missions.documents import INITIAL, ModelReference
from fleet.storage.layout import FleetPaths
from fleet.storage.port import Storage


def latest_models(
    storage: Storage, paths: FleetPaths, number: int, subsets: Iterable[str]
) -> tuple[ModelReference, ...]:
    """The models of a mission.

    Args:
        number: The mission; only what was retrained after earlier ones counts.
        subsets: Keys of the fleet's subsets.
    """
    there = {entry.path for entry in storage.list(f"{paths.root}/missions")}
    found = [ModelReference(key=INITIAL, path=paths.initial_model)]
    for subset in subsets:
        candidates = (paths.model(mission, subset) for mission in range(number - 1, 0, -1))
        latest = next((path for path in candidates if path in there), None)
        if latest is not None:
            found.append(ModelReference(key=subset, path=latest))
    return tuple(found)

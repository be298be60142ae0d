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
    keys = list(subsets)
    latest: dict[str, str] = {}
    for mission in range(number - 1, 0, -1):
        if len(latest) == len(keys):
            break
        there = {entry.path for entry in storage.list(f"{paths.mission(mission)}/models")}
        for subset in keys:
            if paths.model(mission, subset) in there:
                latest.setdefault(subset, paths.model(mission, subset))
    retrained = [ModelReference(key=subset, path=latest[subset]) for subset in keys if subset in latest]
    return (ModelReference(key=INITIAL, path=paths.initial_model), *retrained)

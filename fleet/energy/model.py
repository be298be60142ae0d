"""The energy model that a FleetSpec names."""

from __future__ import annotations

from pathlib import Path

from fleet.energy.accounting import EnergyModel
from fleet.energy.profiles import load_aircraft, load_edge
from fleet.spec.resources import Fleet


def energy_model(fleet: Fleet, folder: Path | None = None) -> EnergyModel:
    """Energy and time of a fleet's actions and edge tasks, by its profiles.

    Args:
        folder: Where the FleetSpec's own files are; the working directory when left out, as in a pod.

    Raises:
        SpecError: there is no such profile.
    """
    hovering = fleet.workflow.decide == "Hovering"
    aircraft = load_aircraft(fleet.agents.energy_profile, folder)
    return EnergyModel(aircraft, load_edge(fleet.workflow.edge_profile, folder), hovering)

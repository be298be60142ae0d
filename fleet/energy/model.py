"""The energy model that a FleetSpec names."""

from __future__ import annotations

from fleet.energy.accounting import EnergyModel
from fleet.energy.profiles import load_aircraft, load_edge
from fleet.spec.resources import Fleet


def energy_model(fleet: Fleet) -> EnergyModel:
    """Energy and time of a fleet's actions and edge tasks, by its profiles.

    Raises:
        SpecError: there is no such profile.
    """
    hovering = fleet.workflow.decide == "Hovering"
    return EnergyModel(load_aircraft(fleet.agents.energy_profile), load_edge(fleet.workflow.edge_profile), hovering)

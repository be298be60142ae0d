"""What one agent's part of a mission cost, on the scale of the mission's loss, without the truth.

    cost = energy of the flight / energy of visiting and capturing every state of the part
         + states of the part that were not captured / states of the part

Both terms are shares, as the terms of the goals' loss are. Fewer captures save energy and lose knowledge; what is
left is what weights can change: detours, and how many captures a threshold takes.
"""

from __future__ import annotations

from fleet.energy.accounting import EnergyModel
from fleet.missions.layout import Layout
from fleet.spec.swarm import Action


def own_cost(layout: Layout, agent: int, captures: int, uav_energy_j: float, energy: EnergyModel) -> float:
    """Cost of an agent's part.

    Args:
        agent: Index of the agent.
        captures: States captured.
        uav_energy_j: Energy of the aircraft.
    """
    cells = part_cells(layout, agent)
    everything = energy.take_off() + energy.land() + (energy.move(Action.EAST) + energy.capture()) * cells
    return uav_energy_j / everything.energy_j + max(0.0, 1.0 - captures / cells)


def part_cells(layout: Layout, agent: int) -> int:
    """How many states with data are in an agent's part."""
    first, end = layout.parts[agent]
    return sum(len(group) for group in layout.groups[first:end])

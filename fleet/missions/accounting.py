"""What one agent spent in a mission, from what it did; the same for simulated and flown missions."""

from __future__ import annotations

from collections.abc import Sequence

from fleet.energy.accounting import EnergyModel, FlightCounts
from fleet.functions.contract import AgentMetrics, Metrics
from fleet.missions.layout import MOVES, Layout
from fleet.missions.records import Record
from fleet.spec.swarm import Action


def counts_of(records: Sequence[Record]) -> FlightCounts:
    """What an agent did, by its log."""
    moves = [record.move for record in records]
    return FlightCounts(
        moves=tuple(moves.count(move) for move in range(len(MOVES))),
        captures=sum(record.captured for record in records),
        decisions=sum(record.legal != 0 for record in records),
        steps=len(records),
    )


def agent_metrics(agent: str, counts: FlightCounts, energy: EnergyModel, groups: int, explored: int) -> AgentMetrics:
    """Account for one agent's flight.

    Args:
        agent: The agent's name.
        counts: What it did.
        energy: What that costs.
        groups: State groups that are the agent's.
        explored: State groups of these that are behind it.
    """
    cost = energy.flight(counts)
    return AgentMetrics(
        agent=agent,
        steps=counts.steps,
        captures=counts.captures,
        time_s=cost.time_s,
        uav_energy_j=cost.energy_j,
        edge_energy_j=energy.edge_energy_j(counts, cost.time_s),
        groups=groups,
        groups_explored=explored,
    )


def part_cells(layout: Layout, agent: int) -> int:
    """How many states with data are in an agent's part."""
    first, end = layout.parts[agent]
    return sum(len(group) for group in layout.groups[first:end])


def thorough_metrics(layout: Layout, agents: Sequence[str], energy: EnergyModel) -> Metrics:
    """What a mission takes in which every agent visits and captures its part without a detour.

    Args:
        agents: Names, in the layout's order.
    """
    flights = []
    for index, name in enumerate(agents):
        cells, (first, end) = part_cells(layout, index), layout.parts[index]
        moves = tuple(cells if action is Action.EAST else 0 for action in Action)
        counts = FlightCounts(moves, captures=cells, decisions=cells, steps=cells + 1)
        flights.append(agent_metrics(name, counts, energy, groups=end - first, explored=end - first))
    return Metrics(tuple(flights))

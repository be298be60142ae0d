"""The landing of an agent whose workflow can never write it."""

from __future__ import annotations

from fleet.energy.accounting import EnergyModel
from fleet.errors import ObjectNotFound
from fleet.functions.contract import AgentMetrics
from fleet.missions.accounting import agent_metrics, counts_of
from fleet.missions.documents import Landing
from fleet.missions.records import read_log
from fleet.storage.layout import FleetPaths
from fleet.storage.port import Storage


def write_failed_landing(
    storage: Storage, paths: FleetPaths, number: int, agent: str, message: str, energy: EnergyModel
) -> None:
    """Say in storage that an agent's part of a mission is over, with what its log tells; keeps a landing that is there.

    Args:
        energy: What the agent's actions cost.
        message: Why, with the end of a log below its first line; the landing gets the first and the last line.
    """
    path = paths.landing(number, agent)
    if storage.exists(path):
        return
    lines = [line.strip() for line in message.splitlines() if line.strip()]
    message = lines[0] if len(lines) < 2 else f"{lines[0]} {lines[-1]}"
    metrics = _metrics_so_far(storage, paths.log(number, agent), agent, energy)
    landing = Landing(agent=agent, failed=True, message=message, metrics=metrics)
    storage.write(path, landing.model_dump_json(by_alias=True, indent=1).encode())


def has_failed(storage: Storage, paths: FleetPaths, number: int, agent: str) -> bool:
    """Whether an agent's landing says that it failed. Raises ObjectNotFound when it has not landed."""
    return Landing.model_validate_json(storage.read(paths.landing(number, agent))).failed


def _metrics_so_far(storage: Storage, log: str, agent: str, energy: EnergyModel) -> AgentMetrics:
    """What the agent's log accounts for, as if it landed in the last state; which groups are behind it is not known."""
    try:
        records = read_log(storage.read(log))
    except ObjectNotFound:
        records = ()
    return agent_metrics(agent, counts_of(records), energy, groups=0, explored=0) if records else AgentMetrics(agent)

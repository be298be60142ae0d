"""The small fleet of the crash tests: one field, two agents, stand-in roles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.fleet_runs import spec_document, write_application

FLEET = "plots"
AGENTS = 2


def write_library(folder: Path) -> Path:
    """The library folder of an operator's image: the files beside the FleetSpec."""
    write_application(folder / FLEET)
    return folder


def fleet_spec(namespace: str, missions: int) -> dict[str, Any]:
    """The FleetSpec as a user applies it."""
    document = spec_document(
        agents={"count": AGENTS},
        missions={"count": missions, "agentRetries": 3},
        storage={"onDelete": "Delete"},
        # What aggregators share must not change when another run loses a node.
        scheduling={"cpu": "4", "memory": "4Gi"},
    )
    document["metadata"] = {"name": FLEET, "namespace": namespace}
    return document

"""The small fleet of the crash tests: one field, two agents, stand-in roles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.fleet_runs import spec_document, write_application

FLEET = "plots"
AGENTS = 2


@dataclass(frozen=True)
class Story:
    """What a run goes through by itself.

    Args:
        missions: How many are flown.
        faults: What the stand-in roles do wrong; see tests/stand_in_roles.py.
    """

    missions: int
    faults: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


SMOOTH = Story(missions=1)
LONG = Story(missions=2)
# One agent can never go on, after the other has landed: the operator lands it, and has the mission evaluated. An
# aggregator is given up.
ROUGH = Story(
    missions=1,
    faults={
        "workflow agent-2": {"sleep": 3, "code": 65, "times": 1},
        "aggregator 1": {"code": 65, "times": 1},
    },
)


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

"""The fleets of the crash tests: two agents over a small field, with stand-ins for the roles or with the real ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from tests.fleet_runs import write_application
from tests.scouting import write_swarm

FLEET = "plots"
AGENTS = 2


@dataclass(frozen=True)
class Story:
    """What a run goes through by itself.

    Args:
        missions: How many are flown.
        faults: What the stand-in roles do wrong; see tests/stand_in_roles.py.
        fleet: Name of the FleetSpec.
        roles: What the pods run: stand-in or real.
    """

    missions: int
    faults: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    fleet: str = FLEET
    roles: str = "stand-in"

    def image(self, namespace: str) -> str:
        """The image of a run's pods; each run has one of its own, so that it can be missing."""
        return f"{self.roles}/{namespace}:1"

    def document(self, library: Path, namespace: str) -> dict[str, Any]:
        """The FleetSpec as a user applies it."""
        document: dict[str, Any] = yaml.safe_load((library / self.fleet / "fleetspec.yaml").read_text())
        document["metadata"]["namespace"] = namespace
        document["spec"]["missions"]["count"] = self.missions
        return document


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


REAL = Story(missions=1, fleet="scout", roles="real")


def write_library(folder: Path) -> Path:
    """The library folder of an operator's image: the FleetSpecs and the files beside them."""
    # What aggregators share must not change when another run loses a node.
    fixed = {"storage": {"onDelete": "Delete"}, "scheduling": {"cpu": "4", "memory": "4Gi"}}
    write_application(folder / FLEET, agents={"count": AGENTS}, missions={"agentRetries": 3}, **fixed)
    write_swarm(folder / REAL.fleet, **fixed)
    return folder

"""The small fleet of the crash tests: one field, two missions, stand-in roles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from tests.fleet_runs import spec_document, write_application

FLEET = "plots"
AGENTS = 2
MISSIONS = 2


def write_library(folder: Path) -> Path:
    """The library folder of an operator's image: the files beside the FleetSpec."""
    write_application(folder / FLEET)
    return folder


def fleet_spec(namespace: str, **changes: Any) -> dict[str, Any]:
    """The FleetSpec as a user applies it."""
    document = spec_document(
        agents={"count": AGENTS},
        missions={"count": MISSIONS, "agentRetries": 3},
        storage={"onDelete": "Delete"},
        **changes,
    )
    document["metadata"] = {"name": FLEET, "namespace": namespace}
    return document


def as_yaml(namespace: str, **changes: Any) -> str:
    """The same for `kubectl apply -f -`."""
    return yaml.safe_dump(fleet_spec(namespace, **changes))

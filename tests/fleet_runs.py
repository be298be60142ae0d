"""Small applications for tests of `fleet run`, with stand-ins for the platform's programs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from fleet.cli import inputs
from fleet.contexts.files import write_cube
from fleet.storage.layout import FleetPaths
from fleet.storage.local import LocalStorage
from fleet.storage.port import Storage
from fleet_operator.compiler.settings import Settings
from fleet_operator.flow.sources import read_bundle
from fleet_operator.local.application import Application, with_changes
from fleet_operator.local.display import Gauge
from fleet_operator.local.events import Event
from fleet_operator.local.service import Summary, run_fleet
from tests.context_builders import plot

ROLES = Path(__file__).parent / "stand_in_roles.py"
SETTINGS = Settings(role_command=("python", str(ROLES)), serve_command=("python", str(ROLES), "serve"))
FUNCTIONS = """
def map_observation(observation):
    return {"exg": 1.0}


def evaluate(fs, metrics):
    return None
"""


def spec_document(**changes: Any) -> dict[str, Any]:
    """A FleetSpec of two agents over one small field."""
    spec: dict[str, Any] = {
        "agents": {"count": 2},
        "stateSpace": {"context": "field", "groups": {"rows": 1, "columns": 2}},
        "map": {"function": "own:map_observation"},
        "eval": {"function": "own:evaluate"},
        "contexts": [{"name": "field", "uri": "field", "use": ["Shaping", "Training", "Mission"]}],
        "goals": [{"metric": "accuracy", "atLeast": 0.7}],
        "missions": {"count": 2, "agentRetries": 3},
        **changes,
    }
    return {
        "apiVersion": "fleetcomputer.io/v1alpha1",
        "kind": "FleetSpec",
        "metadata": {"name": "plots"},
        "spec": spec,
    }


def write_application(folder: Path, **changes: Any) -> Path:
    """Write a FleetSpec with its functions and its context; the file of the FleetSpec."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "own.py").write_text(FUNCTIONS)
    write_cube(plot(), LocalStorage(folder / "field"))
    file = folder / "fleetspec.yaml"
    file.write_text(yaml.safe_dump(spec_document(**changes)))
    return file


def application(folder: Path, missions: int | None = None, seed: int | None = None, **changes: Any) -> Application:
    """An application whose run is in `folder/out`."""
    file = write_application(folder / "app", **changes)
    spec = with_changes(inputs.read_spec(file), missions, seed)
    out = folder / "out"
    return Application(spec, file, out, LocalStorage(out / "storage"), read_bundle(spec.spec, file.parent))


def set_faults(run: Application, faults: Mapping[str, Mapping[str, float]]) -> None:
    """Have stand-ins go wrong; see `stand_in_roles`."""
    folder = f"{run.paths.root}/faults"
    run.storage.delete(folder)
    for program, fault in faults.items():
        run.storage.write(f"{folder}/{program.replace(' ', '/')}.json", json.dumps(fault).encode())


def no_report(storage: Storage, paths: FleetPaths, out: Path) -> Path:
    """Drawing takes seconds, and is tested where it is written."""
    page = out / "report.html"
    page.write_text(f"{storage.uri} {paths.root}")
    return page


def fly(run: Application, display: Recorder | None = None, fresh: bool = False) -> Summary:
    """Run an application with stand-ins."""
    return run_fleet(run, display or Recorder(), fresh, SETTINGS, no_report)


class Recorder:
    """A display that keeps what it was told."""

    draws = False

    def __init__(self) -> None:
        self.phases: list[str] = []
        self.notes: list[str] = []
        self.events: list[Event] = []

    def phase(self, text: str) -> None:
        self.phases.append(text)

    def note(self, text: str) -> None:
        self.notes.append(text)

    def event(self, event: Event) -> None:
        self.events.append(event)

    def gauges(self, gauges: Sequence[Gauge]) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""

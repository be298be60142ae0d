"""The complete status of every situation, its columns, and what other tools and the events make of it.

The tables were read by people; --update-golden writes them anew.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from fleet.spec.crd import KINDS
from fleet.spec.resources import FleetSpec, FleetStatus, Mission, MissionStatus
from fleet.spec.yaml_text import write_yaml
from fleet_operator.policy.lifecycle import phase
from fleet_operator.policy.mission_status import mission_status
from fleet_operator.policy.status import fleet_status, status_manifest, story
from tests.kstatus import kstatus
from tests.situations import MISSIONS, NOW, SITUATIONS

FOLDER = Path(__file__).parent / "status"


def shown(resource: type[FleetSpec | Mission], status: FleetStatus | MissionStatus) -> dict[str, Any]:
    """What `kubectl get`, the conditions and kstatus say; lines are easier to read than nested fields."""
    document = status_manifest(status)
    columns = next(kind.columns for kind in KINDS if kind.model is resource)
    fields = {column.name: column.json_path.removeprefix(".status.") for column in columns}
    conditions = {each["type"]: each for each in document["conditions"]}
    return {
        "columns": {name: document[path] for name, path in fields.items() if path in document},
        "kstatus": kstatus({"metadata": {"generation": status.observed_generation}, "status": document}),
        "conditions": {
            kind: f"{each['status']} {each['reason']}" + (f": {each['message']}" if each["message"] else "")
            for kind, each in conditions.items()
        },
    }


def held(name: str, table: dict[str, Any], update: bool) -> None:
    file = FOLDER / f"{name}.yaml"
    if update:
        file.write_text(write_yaml(table), encoding="utf-8")
    assert table == yaml.safe_load(file.read_text(encoding="utf-8"))


def test_every_situation_of_a_fleet_has_the_status_that_was_read(update_golden: bool) -> None:
    table = {}
    for name, situation in SITUATIONS.items():
        status = fleet_status(situation, None)
        table[name] = shown(FleetSpec, status) | {"events": [" ".join(told) for told in story(None, status)]}
    held("fleets", table, update_golden)


def test_every_situation_of_a_mission_has_the_status_that_was_read(update_golden: bool) -> None:
    table = {}
    for name, situation in MISSIONS.items():
        status = mission_status(situation, None)
        agents = [f"{each.name} {each.phase} {each.steps} {each.message}".strip() for each in status.agents]
        extra = {"agents": agents, "goalsMet": status.goals_met}
        table[name] = shown(Mission, status) | extra
    held("missions", table, update_golden)


def test_every_phase_is_in_the_table() -> None:
    steps = [situation.step for situation in SITUATIONS.values() if situation.step is not None]
    words = {fleet_status(situation, None).phase for situation in SITUATIONS.values()}
    assert words == {phase(step) for step in steps} | {"Pending", "Refused"}
    assert len({type(step) for step in steps}) == 10


def test_a_whole_status_as_kubernetes_has_it() -> None:
    status = status_manifest(fleet_status(SITUATIONS["waiting"], None))
    conditions = status.pop("conditions")
    assert status == {
        "observedGeneration": 3,
        "phase": "Waiting",
        "mission": 1,
        "missionsFlown": 1,
        "missions": "1/3",
        "coverage": "0.250",
        "accuracy": "0.800",
        "goals": "2/2",
        "nextMission": "2026-08-01T06:01:00Z",
        "storageUri": "webhdfs://fleet@namenode:9870/fleet",
    }
    assert conditions[0] == {
        "type": "Ready",
        "status": "True",
        "reason": "Waiting",
        "message": "mission 2 starts at 2026-08-01T06:01:00Z",
        "observedGeneration": 3,
        "lastTransitionTime": NOW,
    }

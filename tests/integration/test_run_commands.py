"""`fleet compile` and `fleet run` as a user types them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import yaml

from fleet_operator.compiler.fleet import to_yaml
from tests.fleet_runs import write_application

ROOT = Path(__file__).parent.parent.parent
CALL = """
import sys, typer
from fleet_operator.local import commands
app = typer.Typer()
app.command("compile")(commands.compile_spec)
app.command("run")(commands.run)
app()
"""


def fleet(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(ROOT), str(ROOT / "operator")])
    environment = {**os.environ, "PYTHONPATH": path, "NO_COLOR": "1", "COLUMNS": "200"}
    command = [sys.executable, "-c", CALL, *arguments]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=120
    )


def test_compile_prints_the_same_objects_as_yaml_and_as_json(tmp_path: Path) -> None:
    write_application(tmp_path)
    as_yaml = fleet("compile", "fleetspec.yaml", folder=tmp_path)
    assert as_yaml.returncode == 0, as_yaml.stderr
    assert fleet("compile", "fleetspec.yaml", folder=tmp_path).stdout == as_yaml.stdout
    as_json = json.loads(fleet("compile", "fleetspec.yaml", "--json", folder=tmp_path).stdout)
    assert to_yaml(as_json) == as_yaml.stdout
    kinds = [manifest["kind"] for manifest in yaml.safe_load_all(as_yaml.stdout)]
    shared = ["PriorityClass"] * 11 + ["ConfigMap"] + ["NetworkPolicy"] * 3
    assert kinds == [*shared, "Job", "Mission", *["Service", "Job", "Job"] * 2, *["Job"] * 4]


def test_help_says_what_an_interrupted_run_does(tmp_path: Path) -> None:
    shown = " ".join(fleet("run", "--help", folder=tmp_path).stdout.split())
    assert "the same command goes on from there" in shown
    assert "Exit code 0 when the last mission met every goal, 1 when it missed one." in shown


def test_nothing_is_made_for_a_fleetspec_with_problems(tmp_path: Path) -> None:
    file = write_application(tmp_path)
    file.write_text(file.read_text().replace("accuracy", "ACCURACY"))
    ended = fleet("run", "fleetspec.yaml", folder=tmp_path)
    assert ended.returncode != 0
    assert "SpecError" in ended.stderr
    assert not (tmp_path / "fleet-out").exists()

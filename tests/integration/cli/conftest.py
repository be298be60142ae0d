"""The `fleet` command as a user calls it: in this process where that is enough, else as a program."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from fleet.cli.main import app
from fleet.cli.scaffold.application import make_application

ROOT = Path(__file__).resolve().parents[3]
Invoke = Callable[..., Result]
Program = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def invoke(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Invoke:
    """Calls `fleet` in this process, with a cache of its own and sys.path as it was afterwards."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(sys, "path", list(sys.path))
    sys.modules.pop("my_swarm", None)  # that of another test

    def call(*arguments: object) -> Result:
        result = CliRunner().invoke(app, [str(argument) for argument in arguments])
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return result

    return call


@pytest.fixture
def program(tmp_path: Path) -> Program:
    """Starts `python -m fleet.cli` in a folder of its own."""
    folder = tmp_path / "here"
    folder.mkdir()
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(str(path) for path in (ROOT, ROOT / "operator")),
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
    }

    def call(*arguments: object, before: str = "", cwd: Path = folder) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, *(["-c", before] if before else ["-m", "fleet.cli"])]
        return subprocess.run(
            [*command, *map(str, arguments)],
            cwd=cwd,
            env=environment,
            capture_output=True,
            text=True,
            timeout=180,
            check=False,
        )

    return call


@pytest.fixture
def my_swarm(tmp_path: Path) -> Path:
    """The FleetSpec of a new application, with little to learn so that tests are quick."""
    make_application(tmp_path / "my-swarm")
    spec = tmp_path / "my-swarm" / "fleetspec.yaml"
    text = spec.read_text()
    for long, short in (("epochs: 12, missions: 32", "epochs: 4, missions: 4"), ("missions: 128", "missions: 4")):
        assert long in text
        text = text.replace(long, short)
    spec.write_text(text)
    return spec

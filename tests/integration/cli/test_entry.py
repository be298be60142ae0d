from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from fleet.cli import extensions

Invoke = Callable[..., Result]
Program = Callable[..., subprocess.CompletedProcess[str]]
COMMANDS = ["init", "validate", "compile", "run", "report", "explain"]
COMMANDS += ["simulate", "shape", "train", "context", "serve", "version"]
HEAVY = {"numpy", "matplotlib", "numba", "pyarrow", "cv2", "skopt", "scipy", "uvicorn", "httpx", "jinja2"}


def test_help_lists_every_command_in_the_order_of_use(invoke: Invoke) -> None:
    text = invoke("--help").output
    places = [text.index(f"│ {name} ") for name in COMMANDS]
    assert places == sorted(places)


@pytest.mark.parametrize("call", [("--help",), ("run", "--help"), ("--version",)])
def test_help_loads_nothing_heavy(program: Program, call: tuple[str, ...]) -> None:
    look = (
        "import sys, fleet.cli.main as main\n"
        "try: main.app(prog_name='fleet')\n"
        f"finally: print('HEAVY', sorted({HEAVY!r} & sys.modules.keys()))"
    )
    done = program(*call, before=look)
    assert done.stdout.rstrip().endswith("HEAVY []"), done.stdout + done.stderr


@pytest.mark.parametrize(
    "command",
    [
        *([name] for name in COMMANDS if name != "context"),
        ["context", "import"],
        ["context", "check"],
        ["context", "show"],
    ],
    ids=" ".join,
)
def test_the_help_of_every_command_has_an_example(invoke: Invoke, command: list[str]) -> None:
    done = invoke(*command, "-h")
    assert done.exit_code == 0
    assert f"Example: fleet {' '.join(command)}" in " ".join(done.output.split())


def test_an_unknown_command_is_answered_with_a_near_one(program: Program) -> None:
    done = program("vaildate")
    assert (done.returncode, done.stdout) == (2, "")
    assert "'validate'" in done.stderr


def test_the_version_is_that_of_the_package(invoke: Invoke) -> None:
    assert invoke("--version").output == "fleet 0.1.0\n"
    versions = json.loads(invoke("version", "--json").output)
    assert versions["fleet"] == "0.1.0"
    assert {"python", "numpy", "numba"} <= versions.keys()


def test_a_wrong_input_has_no_traceback_but_with_debug(program: Program, tmp_path: Path) -> None:
    quiet, loud = program("report", tmp_path / "nothing"), program("--debug", "report", tmp_path / "nothing")
    assert (quiet.returncode, loud.returncode) == (2, 2)
    assert "Traceback" not in quiet.stderr
    assert "Traceback" in loud.stderr
    assert quiet.stderr.splitlines()[0] == "error: the command line has 1 problem"


def test_a_folder_that_cannot_be_made_is_told_in_a_line(program: Program, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = program("init", tmp_path / "file" / "my-swarm")
    assert done.returncode == 2
    assert re.fullmatch(r"error: .*my-swarm.*: there is a file where a folder is needed; name another\n", done.stderr)


def test_a_fault_of_ours_is_not_taken_for_a_missed_goal(program: Program) -> None:
    fault = (
        "import fleet.cli.main as main, fleet.cli.scaffold.application as application\n"
        "application.make_application = lambda name: 1 / 0\n"
        "main.run()"
    )
    done = program("init", "my-swarm", before=fault)
    assert done.returncode == 65
    assert "ZeroDivisionError" in done.stderr
    assert done.stderr.rstrip().endswith("this is a fault in fleet, not in your input; the lines above say where")


def test_a_reader_that_goes_away_is_no_error(tmp_path: Path) -> None:
    command = f"{sys.executable} -m fleet.cli version --json | {sys.executable} -c 'pass'; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, timeout=60, check=True, env=with_path(tmp_path)
    )
    assert done.stderr == ""
    assert done.stdout.strip() in ("0", "141")


def test_ctrl_c_ends_with_130_and_no_traceback(my_swarm: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "fleet.cli", "simulate", str(my_swarm), "--missions", "100000"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=with_path(tmp_path)
    ) as process:
        while not list(tmp_path.glob("cache/fleet/*/default/my-swarm/mapped/*.npz")):
            assert process.poll() is None
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=60)
    # Python ends by the signal itself when the interrupt fell into code made from text, as in the body of a dataclass.
    assert process.returncode in (130, -signal.SIGINT)
    assert (output, errors.splitlines()[-1]) == ("", "error: interrupted")
    assert "Traceback" not in errors


def test_a_shell_completes_commands(tmp_path: Path) -> None:
    environment = {"_FLEET_COMPLETE": "complete_bash", "COMP_WORDS": "fleet va", "COMP_CWORD": "1"}
    start = "import fleet.cli.main as main; main.app(prog_name='fleet')"
    done = subprocess.run(
        [sys.executable, "-c", start],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**with_path(tmp_path), **environment},
    )
    assert done.stdout.split() == ["validate"]


def test_a_command_of_another_package_joins(invoke: Invoke, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    install(monkeypatch, tmp_path, "greet = greeting:greet")
    (tmp_path / "greeting.py").write_text('def greet(name: str) -> None:\n    """Greet."""\n    print("hello", name)\n')
    assert "greet" in invoke("--help").output
    assert invoke("greet", "fleet").output == "hello fleet\n"


def test_a_command_that_cannot_be_loaded_says_why(
    invoke: Invoke, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    install(monkeypatch, tmp_path, "greet = a_module_that_is_not_there:greet")
    assert "Not available" in invoke("--help").output
    done = invoke("greet", "fleet", "--loud")
    assert done.exit_code == 65
    assert "No module named 'a_module_that_is_not_there'" in done.output


def test_a_command_whose_package_is_missing_says_so(invoke: Invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extensions, "GROUP", "a group of which no package is installed")
    done = invoke("run", "fleetspec.yaml", "--missions", "2")
    assert done.exit_code == 65
    assert "its package fleet_operator is not installed" in done.output


def install(monkeypatch: pytest.MonkeyPatch, folder: Path, entry: str) -> None:
    """A distribution with one command, as pip would leave it."""
    metadata = folder / "greeting-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: greeting\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[fleet.commands]\n{entry}\n")
    monkeypatch.syspath_prepend(folder)


def with_path(tmp_path: Path) -> dict[str, str]:
    root = Path(__file__).resolve().parents[3]
    path = os.pathsep.join(str(folder) for folder in (root, root / "operator"))
    return {**os.environ, "PYTHONPATH": path, "XDG_CACHE_HOME": str(tmp_path / "cache")}

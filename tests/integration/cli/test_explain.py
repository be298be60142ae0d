from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from fleet.missions.records import read_log
from fleet.storage.local import LocalStorage
from tests.flown_missions import PATHS, fly_missions, put, spec_of

Invoke = Callable[..., Result]


@pytest.fixture(scope="session")
def flown_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flown")
    fly_missions(folder / "storage")
    return folder


@pytest.fixture
def run(flown_once: Path, tmp_path: Path) -> Path:
    """Folder of a run of two missions, for one test to change."""
    shutil.copytree(flown_once, tmp_path / "run")
    return tmp_path / "run"


def storage_of(run: Path) -> LocalStorage:
    return LocalStorage(run / "storage")


def test_a_step_is_told_with_its_place_scores_and_choice(invoke: Invoke, run: Path) -> None:
    record = read_log(storage_of(run).read(PATHS.log(2, "agent-2")))[1]
    done = invoke("explain", run, "--agent", "2", "--step", 1)
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    assert lines[0].startswith("Mission 2 over field, agent-2, step 1 of ")
    assert lines[1].startswith(f"where     row {record.row}, column {record.column} (cell {record.cell}), ")
    choice = next(line for line in lines if line.startswith("choice"))
    assert choice.startswith(f"choice    {record.action}: ")
    assert [line.split()[0] for line in lines[lines.index("") + 2 :]] == ["initial", "2", "1", "blended"]


def test_without_a_step_all_steps_are_told_in_short(invoke: Invoke, run: Path) -> None:
    records = read_log(storage_of(run).read(PATHS.log(1, "agent-1")))
    done = invoke("explain", run, "--agent", "agent-1", "--mission", 1)
    title, header, *rows = done.stdout.splitlines()
    assert title == "Mission 1 over field, agent-1"
    assert header.split() == ["step", "row", "col", "captured", "group", "legal", "move", "why"]
    assert [row.split()[:3] for row in rows] == [[str(one.step), str(one.row), str(one.column)] for one in records]
    assert rows[-1].split()[-4:] == ["Land", "all", "groups", "explored"]


def test_for_machines_the_steps_are_one_document(invoke: Invoke, run: Path) -> None:
    records = read_log(storage_of(run).read(PATHS.log(2, "agent-1")))
    told = json.loads(invoke("explain", run, "--agent", "1", "--json").stdout)
    assert (told["mission"], told["agent"], told["recorded"], told["lost"]) == (2, "agent-1", len(records), 0)
    assert [step["move"] for step in told["steps"]] == [record.action for record in records]
    alone = json.loads(invoke("explain", run, "--agent", "1", "--step", 3, "--json").stdout)
    assert alone["steps"] == [told["steps"][3]]


@pytest.mark.parametrize(
    ("options", "message", "hint"),
    [
        (("--agent", "agent-7"), "there is no agent agent-7", "choose one of agent-1, agent-2, or 1 to 2"),
        (("--agent", "0"), "there is no agent 0", "choose one of agent-1, agent-2, or 1 to 2"),
        (("--agent", "2", "--mission", "9"), "agent-2 has no log of a mission 9", "it has those of 1, 2"),
        (("--agent", "2", "--mission", "0"), "agent-2 has no log of a mission 0", "it has those of 1, 2"),
        (("--agent", "2", "--step", "999"), "the log of agent-2 in mission 2 has no step 999", "it has steps 0 to "),
        (("--agent", "2", "--step", "-1"), "the log of agent-2 in mission 2 has no step -1", "it has steps 0 to "),
        (("--agent", "2", "--fleet", "a/b"), "there is no fleet a/b", "choose one of default/plots"),
    ],
)
def test_what_is_not_there_is_answered_with_what_there_is(
    invoke: Invoke, run: Path, options: tuple[str, ...], message: str, hint: str
) -> None:
    done = invoke("explain", run, *options)
    assert (done.exit_code, done.stdout) == (2, "")
    assert message in done.stderr
    assert hint in done.stderr


def test_a_folder_without_a_run_is_refused(invoke: Invoke, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for folder, message in (("nowhere", "there is no folder"), ("empty", "there is no run in")):
        done = invoke("explain", tmp_path / folder, "--agent", 1)
        assert done.exit_code == 2
        assert message in done.stderr


def test_an_agent_that_never_flew_is_said_so(invoke: Invoke, run: Path) -> None:
    for number in (1, 2):
        storage_of(run).delete(PATHS.log(number, "agent-2"))
    done = invoke("explain", run, "--agent", "2")
    assert done.exit_code == 2
    assert "agent-2 has no log of any mission" in done.stderr


def test_a_run_without_models_cannot_be_explained_and_says_what_is_missing(invoke: Invoke, run: Path) -> None:
    storage_of(run).delete(f"{PATHS.root}/models")
    done = invoke("explain", run, "--agent", "2", "--step", "0")
    assert (done.exit_code, done.stdout) == (65, "")
    assert "error: what agent-2 flew mission 2 with is not whole: there is no object" in done.stderr


def test_a_damaged_fleetspec_is_said_so(invoke: Invoke, run: Path) -> None:
    storage_of(run).write(PATHS.fleet_spec, b"{")
    done = invoke("explain", run, "--agent", "2")
    assert done.exit_code == 65
    assert "error: the FleetSpec of the run cannot be read" in done.stderr


def test_a_log_with_a_hole_is_told_up_to_it_with_a_warning(invoke: Invoke, run: Path) -> None:
    path = PATHS.log(2, "agent-2")
    lines = [line for line in storage_of(run).read(path).splitlines() if line]
    storage_of(run).write(path, b"\n".join([*lines[:3], *lines[4:]]))
    done = invoke("explain", run, "--agent", "2")
    assert done.exit_code == 0
    assert len(done.stdout.splitlines()) == 2 + 3
    damage = f"the log is damaged: step 3 is missing, so {len(lines) - 4} after it cannot be explained"
    assert done.stderr == f"warning: {damage}\n"
    beyond = invoke("explain", run, "--agent", "2", "--step", "3")
    assert beyond.exit_code == 2
    assert f"it has steps 0 to 2; {damage}" in beyond.stderr


def test_a_log_that_ends_in_the_air_is_told_with_a_warning(invoke: Invoke, run: Path) -> None:
    path = PATHS.log(2, "agent-2")
    lines = [line for line in storage_of(run).read(path).splitlines() if line]
    storage_of(run).write(path, b"\n".join(lines[:5]))
    done = invoke("explain", run, "--agent", "2", "--step", "4")
    assert (done.exit_code, done.stdout.splitlines()[0]) == (0, "Mission 2 over field, agent-2, step 4 of 4")
    assert done.stderr.startswith("warning: the log ends before the landing: ")


def test_a_run_is_explained_where_the_files_of_its_fleetspec_are_not(invoke: Invoke, run: Path) -> None:
    agents = {"count": 2, "energyProfile": "profiles.yaml#a-profile-of-its-own"}
    put(storage_of(run), PATHS.fleet_spec, spec_of(agents=agents))
    assert invoke("explain", run, "--agent", "2", "--step", "0").exit_code == 0

"""init, validate, simulate, shape and train on a new application."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from typer.testing import Result

from fleet.cli.inputs import read_spec, storage_uri
from fleet.cli.scaffold.application import make_application, module_of
from fleet.errors import SpecError
from tests.conftest import ROOT

Invoke = Callable[..., Result]
Program = Callable[..., subprocess.CompletedProcess[str]]


def test_init_makes_an_application_that_is_valid_and_whose_test_passes(invoke: Invoke, tmp_path: Path) -> None:
    made = invoke("init", tmp_path / "my-swarm")
    assert made.exit_code == 0
    files = [file.relative_to(tmp_path / "my-swarm") for file in tmp_path.rglob("*") if file.is_file()]
    assert sorted(file.as_posix() for file in files) == [
        "README.md",
        "contexts/field/context.yaml",
        "contexts/field/features.parquet",
        "contexts/practice/context.yaml",
        "contexts/practice/features.parquet",
        "fleetspec.yaml",
        "my_swarm.py",
        "test_my_swarm.py",
    ]
    valid = invoke("validate", tmp_path / "my-swarm/fleetspec.yaml", "--json")
    assert json.loads(valid.stdout) == {
        "source": str(tmp_path / "my-swarm/fleetspec.yaml"),
        "valid": True,
        "problems": [],
        "warnings": [],
    }
    tested = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"],
        cwd=tmp_path / "my-swarm",
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert tested.returncode == 0, tested.stdout


@pytest.mark.slow
def test_a_new_application_flies_at_once(program: Program, tmp_path: Path) -> None:
    assert program("init", tmp_path / "my-swarm").returncode == 0
    flown = program("run", tmp_path / "my-swarm/fleetspec.yaml", "--out", tmp_path / "out")
    assert flown.returncode == 0, flown.stderr
    assert (tmp_path / "out/report.html").is_file()
    again = program("report", tmp_path / "out", "--json")
    missions = json.loads(again.stdout)["missions"]
    assert [one["goals_met"] for one in missions] == [True, True]
    spec, storage = tmp_path / "my-swarm/fleetspec.yaml", tmp_path / "out/storage"
    simulated = json.loads(program("simulate", spec, "--storage", storage, "--missions", 1, "--json").stdout)
    means = {name: row["mean"] for name, row in simulated["metrics"].items()}
    assert {name: missions[0]["metrics"][name] for name in means} == pytest.approx(means, rel=1e-9)


def test_two_applications_of_one_name_are_the_same(tmp_path: Path) -> None:
    make_application(tmp_path / "one" / "my-swarm")
    make_application(tmp_path / "two" / "my-swarm")
    for file in (tmp_path / "one").rglob("*.*"):
        if file.is_file():
            other = tmp_path / "two" / file.relative_to(tmp_path / "one")
            assert file.read_bytes() == other.read_bytes()


def test_training_leaves_a_run_with_flown_missions_alone(invoke: Invoke, my_swarm: Path, tmp_path: Path) -> None:
    reward = tmp_path / "out/storage/default/my-swarm/models/reward.json"
    flown = tmp_path / "out/storage/default/my-swarm/missions/0001/evaluation.json"
    for file in (reward, flown):
        file.parent.mkdir(parents=True)
        file.write_text("{}")
    for command in ("shape", "train"):
        done = invoke(command, my_swarm, "--out", tmp_path / "out")
        assert done.exit_code == 2
        assert "has missions that were flown with its reward and model\n      name another folder" in done.stderr
    assert reward.read_text() == "{}"


def test_init_overwrites_nothing(invoke: Invoke, tmp_path: Path) -> None:
    (tmp_path / "my-swarm").mkdir()
    assert invoke("init", tmp_path / "my-swarm").exit_code == 0
    (tmp_path / "my-swarm/my_swarm.py").write_text("mine")
    again = invoke("init", tmp_path / "my-swarm")
    assert again.exit_code == 2
    assert "is there already" in again.output
    assert (tmp_path / "my-swarm/my_swarm.py").read_text() == "mine"
    assert [file.name for file in tmp_path.iterdir() if file.name.startswith(".")] == []


@pytest.mark.parametrize("name", ["My-Swarm", "my_swarm", "-swarm", "swarm-", "s" * 41, "schwärm", "my swarm"])
def test_init_takes_only_names_that_a_fleet_may_have(tmp_path: Path, name: str) -> None:
    with pytest.raises(SpecError, match="is not a name for a fleet"):
        make_application(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "module"),
    [
        ("my-swarm", "my_swarm"),
        ("import", "swarm_import"),
        ("json", "swarm_json"),
        ("fleet", "swarm_fleet"),
        ("numpy", "swarm_numpy"),
        ("2-drones", "swarm_2_drones"),
    ],
)
def test_the_module_of_an_application_hides_no_other(name: str, module: str) -> None:
    assert module_of(name) == module


def test_validate_shows_every_problem_with_its_place_and_a_way_out(invoke: Invoke, my_swarm: Path) -> None:
    text = my_swarm.read_text()
    text = (
        text.replace("agents: {count: 2}", "agents: {count: two}")
        .replace("atLeast: 0.6", "atLeast: much")
        .replace("use: [Mission]", "use: [Fly]")
    )
    my_swarm.write_text(text)
    done = invoke("validate", my_swarm)
    assert done.exit_code == 2
    for path in ("spec.agents.count", "spec.goals[0].atLeast", "spec.contexts[1].use[0]"):
        assert path in done.stdout
    found = json.loads(invoke("validate", my_swarm, "--json").stdout)
    assert found["valid"] is False
    assert len(found["problems"]) == 3
    assert all(problem["message"] and problem["line"] for problem in found["problems"])


def test_validate_of_a_file_that_is_not_there_is_a_problem_too(invoke: Invoke, tmp_path: Path) -> None:
    done = invoke("validate", tmp_path / "nothing.yaml")
    assert done.exit_code == 2
    assert "cannot be read" in done.output


def test_simulate_needs_no_training_and_repeats_itself(invoke: Invoke, my_swarm: Path) -> None:
    first = json.loads(invoke("simulate", my_swarm, "--missions", 3, "--json").stdout)
    second = json.loads(invoke("simulate", my_swarm, "--missions", 3, "--json").stdout)
    other = json.loads(invoke("simulate", my_swarm, "--missions", 3, "--seed", 1, "--json").stdout)
    assert first.pop("steps_per_second") > 0
    assert second.pop("steps_per_second") > 0
    assert first == second
    assert first["metrics"] != other["metrics"]
    assert (first["missions"], first["policy"], first["exploration"]) == (3, "random moves", 1.0)
    for row in first["metrics"].values():
        assert row["min"] <= row["mean"] <= row["max"]


def test_simulate_without_exploration_flies_one_mission_over_and_over(invoke: Invoke, my_swarm: Path) -> None:
    found = json.loads(invoke("simulate", my_swarm, "--missions", 3, "--exploration", 0, "--json").stdout)
    assert all(row["min"] == row["max"] for row in found["metrics"].values())


def test_simulate_shows_a_table(invoke: Invoke, my_swarm: Path) -> None:
    lines = invoke("simulate", my_swarm, "--missions", 2).stdout.splitlines()
    assert lines[0] == "2 missions over field, policy: random moves"
    assert lines[1].split() == ["metric", "mean", "least", "greatest"]
    assert [line.split()[0] for line in lines[2:4]] == ["accuracy", "coverage"]


def test_another_field_takes_the_place_of_a_context(invoke: Invoke, my_swarm: Path) -> None:
    practice = my_swarm.parent / "contexts/practice"
    here = json.loads(invoke("simulate", my_swarm, "--missions", 1, "--json").stdout)
    there = json.loads(invoke("simulate", my_swarm, "--missions", 1, "--json", "--context", f"field={practice}").stdout)
    assert here["metrics"]["mae"] != there["metrics"]["mae"]


def test_profiles_are_looked_for_beside_the_fleetspec(invoke: Invoke, my_swarm: Path) -> None:
    built_in = (ROOT / "fleet/energy/profiles.yaml").read_text()
    (my_swarm.parent / "own.yaml").write_text(built_in)
    text = my_swarm.read_text()
    before = json.loads(invoke("simulate", my_swarm, "--missions", 1, "--json").stdout)
    my_swarm.write_text(text.replace("agents: {", "agents: {energyProfile: own.yaml#spark-survey, "))
    assert "own.yaml" in my_swarm.read_text()
    done = invoke("simulate", my_swarm, "--missions", 1, "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["metrics"] == before["metrics"]


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("field", "is not NAME=DIR"),
        ("field=nowhere", "there is no folder"),
        ("meadow=.", "there is no context 'meadow'"),
    ],
)
def test_a_wrong_context_is_told(invoke: Invoke, my_swarm: Path, value: str, expected: str) -> None:
    done = invoke("simulate", my_swarm, "--context", value)
    assert done.exit_code == 2
    assert expected in done.output


def test_a_function_that_cannot_be_imported_is_told(invoke: Invoke, my_swarm: Path) -> None:
    (my_swarm.parent / "my_swarm.py").write_text(
        "import a_module_that_is_not_there\n\ndef map_observation(x): ...\ndef evaluate(x, y): ...\n"
    )
    done = invoke("simulate", my_swarm)
    assert done.exit_code in (2, 65)
    assert "a_module_that_is_not_there" in done.output


def test_train_shapes_first_and_leaves_what_the_roles_and_the_simulator_read(
    invoke: Invoke, my_swarm: Path, tmp_path: Path
) -> None:
    shaped = json.loads(invoke("shape", my_swarm, "--out", tmp_path / "out", "--workers", 1, "--json").stdout)
    trained = json.loads(invoke("train", my_swarm, "--out", tmp_path / "out", "--workers", 1, "--json").stdout)
    assert shaped["reward"] == trained["reward"]
    assert set(shaped["reward"]["features"]) == {"exg", "soil"}
    storage = tmp_path / "out/storage"
    root = storage / "default/my-swarm"
    assert (root / "models/reward.json").is_file()
    assert (root / "models/initial.npz").is_file()
    flown = json.loads(invoke("simulate", my_swarm, "--missions", 2, "--storage", storage, "--json").stdout)
    assert (flown["policy"], flown["exploration"]) == ("QLearning, trained", 0.0)
    assert flown["visited_threshold"] == trained["reward"]["visited_threshold"]
    report = invoke("report", tmp_path / "out")
    assert (report.exit_code, report.stdout.splitlines()[0]) == (0, "No mission has been flown.")


def test_a_trained_swarm_needs_no_context_to_learn_from(invoke: Invoke, my_swarm: Path, tmp_path: Path) -> None:
    first = json.loads(invoke("train", my_swarm, "--out", tmp_path / "first", "--workers", 1, "--json").stdout)
    model = tmp_path / "first/storage/default/my-swarm/models/initial.npz"
    (my_swarm.parent / "trained.npz").write_bytes(model.read_bytes())
    document = yaml.safe_load(my_swarm.read_text())
    flown = document["spec"]["stateSpace"]["context"]
    document["spec"] |= {
        "contexts": [{**one, "use": ["Mission"]} for one in document["spec"]["contexts"] if one["name"] == flown],
        "sa": {"pretrained": "trained.npz"},
        "ha": {"utilityThreshold": 2.5, "visitedThreshold": 4},
        "rewardShaping": {"weights": dict.fromkeys(first["reward"]["features"], 0.5)},
    }
    my_swarm.write_text(yaml.safe_dump(document))
    assert invoke("validate", my_swarm).exit_code == 0
    done = invoke("train", my_swarm, "--out", tmp_path / "second", "--workers", 1, "--json")
    assert done.exit_code == 0, done.output
    reward = json.loads(done.stdout)["reward"]
    assert reward["normaliser"] == first["reward"]["normaliser"]
    assert (reward["weights"], reward["utility_threshold"], reward["visited_threshold"]) == ([0.5, 0.5], 2.5, 4)
    assert (tmp_path / "second/storage/default/my-swarm/models/initial.npz").read_bytes() == model.read_bytes()


def test_the_storage_of_the_fleetspec_is_used_and_found_again(invoke: Invoke, my_swarm: Path, tmp_path: Path) -> None:
    place = (tmp_path / "elsewhere").as_uri()
    my_swarm.write_text(f"{my_swarm.read_text().rstrip()}\n  storage: {{uri: {place}}}\n")
    out = tmp_path / "out"
    trained = json.loads(invoke("train", my_swarm, "--out", out, "--workers", 1, "--json").stdout)
    assert trained["storage"] == place
    assert not (out / "storage").exists()
    assert storage_uri(read_spec(my_swarm), out, given="file:///given") == "file:///given"
    out.mkdir()
    (out / "run.json").write_text(json.dumps({"storageUri": place}))  # as `fleet run` leaves it
    assert invoke("report", out).exit_code == 0
    assert (out / "report.html").is_file()


def test_simulate_without_the_policy_that_it_is_told_to_use_says_what_to_do(
    invoke: Invoke, my_swarm: Path, tmp_path: Path
) -> None:
    done = invoke("simulate", my_swarm, "--storage", tmp_path / "nothing")
    assert done.exit_code == 2
    assert "run fleet train SPEC" in done.output


def test_a_name_that_would_hide_the_package_is_refused(invoke: Invoke, tmp_path: Path) -> None:
    refused = invoke("init", tmp_path / "fleet")
    assert refused.exit_code == 2
    assert "a folder called fleet hides the package of that name" in refused.output
    assert not (tmp_path / "fleet").exists()

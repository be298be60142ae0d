"""validate, simulate, shape and train of an application whose agents plan."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import Result

from fleet.learning.planner import PlannerModel, load_planner
from fleet.planning.tactics import InterestWeights

Invoke = Callable[..., Result]
USUAL = InterestWeights().model_dump()
ROOT = "default/my-swarm"


def changed(spec: Path, name: str = "fleetspec.yaml", **parts: Any) -> Path:
    """The FleetSpec with some parts of its spec replaced, beside it."""
    document = yaml.safe_load(spec.read_text())
    document["spec"] |= parts
    (spec.parent / name).write_text(yaml.safe_dump(document))
    return spec.parent / name


@pytest.fixture
def planner(my_swarm: Path) -> Path:
    """The FleetSpec of a new application, with agents that plan."""
    return changed(my_swarm, sa={"kind": "Planner"})


@pytest.fixture
def grouped(planner: Path) -> Path:
    """The same with agents that fly through state groups."""
    return changed(planner, "groups.yaml", sa={"kind": "QLearning"})


def said(done: Result) -> Any:
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def simulated(invoke: Invoke, spec: Path, *arguments: object) -> dict[str, Any]:
    found: dict[str, Any] = said(invoke("simulate", spec, "--missions", 2, "--json", *arguments))
    assert found.pop("steps_per_second") > 0
    return found


def test_a_planner_is_simulated_untrained_and_does_the_same_again(invoke: Invoke, planner: Path) -> None:
    assert said(invoke("validate", planner, "--json"))["warnings"] == []
    first, again = (simulated(invoke, planner) for _ in range(2))
    other = simulated(invoke, planner, "--seed", 1)
    assert first == again
    assert first["metrics"] != other["metrics"]
    assert {name: first[name] for name in ("policy", "missions", "seed", *USUAL)} == {
        "policy": "Planner, not trained", "missions": 2, "seed": 0, **USUAL,
    }  # fmt: skip
    assert first["caution"] == pytest.approx(5.0 - 5.0 * 0.6)
    assert 0.2 < first["asked_share"] < 0.5
    assert first["metrics"]["accuracy"]["min"] < 1.0, "missions end before the whole field is captured"
    assert first["metrics"]["uav_energy_j"]["min"] < first["metrics"]["uav_energy_j"]["max"], "starts differ"


def test_starts_that_are_given_are_kept(invoke: Invoke, planner: Path) -> None:
    members = [{"name": f"a{index}", "start": {"row": 2 * index, "column": 3}} for index in range(2)]
    placed = changed(planner, "placed.yaml", agents={"members": members})
    for row in simulated(invoke, placed)["metrics"].values():
        assert row["min"] == row["max"]


def test_simulate_says_in_words_what_was_flown(invoke: Invoke, planner: Path) -> None:
    lines = invoke("simulate", planner, "--missions", 2).stdout.splitlines()
    assert lines[0] == "2 missions over field, policy: Planner, not trained"
    assert lines[-2].startswith("SA was asked in ")
    assert lines[-2].endswith(" of the states; elsewhere agents went on with their plans")


def test_shape_and_train_leave_what_the_simulator_and_the_roles_read(
    invoke: Invoke, planner: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    shaped = said(invoke("shape", planner, "--out", out, "--workers", 1, "--json"))
    trained = said(invoke("train", planner, "--out", out, "--workers", 1, "--json"))
    reward = trained["reward"]
    assert shaped["reward"] == reward
    assert (reward["planner"]["feature"], reward["planner"]["goal"]) == ("exg", 0.6)
    assert (reward["planner"]["weights"], reward["evaluations"]) == (USUAL, 4)
    model = load_planner((out / "storage" / ROOT / "models/initial.npz").read_bytes(), tuple(reward["features"]))
    assert model.captures > 10
    flown = simulated(invoke, planner, "--storage", out / "storage")
    assert {name: flown[name] for name in ("policy", "caution", *USUAL)} == {
        "policy": "Planner, trained",
        "caution": reward["planner"]["caution"],
        **model.interest.model_dump(),
    }
    assert {name: flown[name] for name in USUAL} != USUAL


def test_shape_and_train_say_in_words_what_they_found(invoke: Invoke, planner: Path, tmp_path: Path) -> None:
    done = invoke("train", planner, "--out", tmp_path / "out", "--workers", 1)
    assert done.exit_code == 0, done.output
    lines = [line.split() for line in done.stdout.splitlines()]
    assert ["weight", "of", "doubt_around", "1.000"] in lines
    assert ["mapped", "exg"] in lines
    assert "rehearsed missions met every goal with this caution." in done.stdout
    assert "SA is trained by 2 missions over the training contexts" in done.stdout


def test_a_planner_flies_without_any_context_to_learn_from(invoke: Invoke, planner: Path, tmp_path: Path) -> None:
    contexts = [one for one in yaml.safe_load(planner.read_text())["spec"]["contexts"] if one["name"] == "field"]
    alone = changed(planner, "alone.yaml", contexts=contexts)
    done = invoke("train", alone, "--out", tmp_path / "out", "--workers", 1)
    assert done.exit_code == 0, done.output
    assert "Nothing was rehearsed: the caution is given, or what is usual for the goal." in done.stdout
    assert "no context is for training: SA is what it was before" in done.stdout
    model = load_planner((tmp_path / "out/storage" / ROOT / "models/initial.npz").read_bytes())
    assert model.captures == 0
    total = sum(USUAL.values())
    assert model.interest.model_dump() == pytest.approx({name: weight / total for name, weight in USUAL.items()})


def test_what_training_contexts_know_the_truth_of_is_mapped(invoke: Invoke, planner: Path, tmp_path: Path) -> None:
    """Map() gives soil first here, and the contexts know excess green."""
    module = planner.parent / "my_swarm.py"
    text = module.read_text()
    assert "compose(excess_green, bare_soil)" in text
    module.write_text(text.replace("compose(excess_green, bare_soil)", "compose(bare_soil, excess_green)"))
    document = yaml.safe_load(planner.read_text())["spec"]["contexts"]
    uses = [{**one, "use": [use for use in one["use"] if use != "Shaping"]} for one in document]
    unshaped = changed(planner, "unshaped.yaml", contexts=uses)
    reward = said(invoke("train", unshaped, "--out", tmp_path / "out", "--workers", 1, "--json"))["reward"]
    assert reward["features"] == ["soil", "exg"]
    assert reward["planner"]["feature"] == "exg"


def test_random_moves_are_refused(invoke: Invoke, planner: Path) -> None:
    done = invoke("simulate", planner, "--exploration", 0.5)
    assert done.exit_code == 2
    assert "--exploration: a Planner makes no random moves\n      leave it out" in done.stderr


@pytest.mark.parametrize("option", ["--storage", "--model"])
def test_what_was_learned_by_another_kind_is_refused(
    invoke: Invoke, planner: Path, grouped: Path, tmp_path: Path, option: str
) -> None:
    wanted = {
        "--storage": (
            "the reward was shaped for state groups, and sa.kind is Planner; train again",
            "the reward was shaped for a Planner, and sa.kind is another; train again",
        ),
        "--model": ("the model has the format 'fleet-q-learning/1', and a Planner flies with", "fleet-planner/1"),
    }
    for trained, flown, expected in ((grouped, planner, wanted[option][0]), (planner, grouped, wanted[option][1])):
        out = tmp_path / trained.stem
        assert invoke("train", trained, "--out", out, "--workers", 1).exit_code == 0
        place = out / "storage" if option == "--storage" else out / "storage" / ROOT / "models/initial.npz"
        done = invoke("simulate", flown, option, place)
        assert done.exit_code != 0
        assert expected in " ".join(done.output.split())


def test_a_pretrained_planner_is_taken_and_one_for_another_map_is_refused(
    invoke: Invoke, planner: Path, tmp_path: Path
) -> None:
    pretrained = changed(planner, "pretrained.yaml", sa={"kind": "Planner", "pretrained": "model.npz"})
    own = InterestWeights(doubt=0.3, doubt_around=0.2, novelty=0.9)
    (planner.parent / "model.npz").write_bytes(PlannerModel.blank(("exg", "soil"), own).to_bytes())
    assert invoke("train", pretrained, "--out", tmp_path / "one", "--workers", 1).exit_code == 0
    model = load_planner((tmp_path / "one/storage" / ROOT / "models/initial.npz").read_bytes())
    assert (model.prior.tolist(), model.captures > 10) == ([0.3, 0.2, 0.9], True)
    (planner.parent / "model.npz").write_bytes(PlannerModel.blank(("ndvi",), own).to_bytes())
    done = invoke("train", pretrained, "--out", tmp_path / "two", "--workers", 1)
    assert done.exit_code != 0
    expected = "the pre-trained model expects the features ndvi, but Map() gives exg, soil; leave sa.pretrained out"
    assert expected in " ".join(done.output.split())
    groups = changed(planner, "of-groups.yaml", sa={"kind": "QLearning", "pretrained": "model.npz"})
    assert invoke("train", groups, "--out", tmp_path / "three", "--workers", 1).exit_code != 0


def test_what_is_to_be_mapped_must_be_what_map_gives(invoke: Invoke, planner: Path, tmp_path: Path) -> None:
    ndvi = changed(planner, "ndvi.yaml", sa={"kind": "Planner", "feature": "ndvi"})
    for command in (("shape", ndvi, "--out", tmp_path / "out", "--workers", 1), ("simulate", ndvi)):
        done = invoke(*command)
        assert done.exit_code != 0
        assert "sa.feature is ndvi, but Map() gives exg, soil; name one of these" in " ".join(done.output.split())

"""`examine`: problems, warnings and missing files of a FleetSpec on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from fleet.errors import Problem
from fleet.spec.check import check, check_files, examine, warnings_of
from fleet.spec.load import parse_fleet_spec
from fleet.spec.yaml_text import write_yaml
from tests.spec_documents import fleet_document

MODULE = """\
from numpy import mean
try:
    import fast as quick
except ImportError:
    quick = None
LIMIT: int = 3

def map_observation(observation): ...
def evaluate(fs, metrics): ...
def with_default(fs, metrics, classes=4, *, verbose=False): ...
def many(*arguments): ...
def named(observation, *, scale): ...
async def later(observation): ...
class Mapper: ...
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the module and the contexts that the smallest FleetSpec names."""
    (tmp_path / "crops.py").write_text(MODULE)
    for name in ("june", "august", "september"):
        (tmp_path / "contexts" / name).mkdir(parents=True)
        (tmp_path / "contexts" / name / "context.yaml").write_text("kind: AutonomyCube\n")
    return tmp_path


def files(folder: Path, **spec: Any) -> list[tuple[str, str, str]]:
    problems = check_files(parse_fleet_spec(fleet_document(**spec)), folder)
    return [(problem.path, problem.message, problem.hint) for problem in problems]


def test_nothing_is_missing_when_everything_is_there(folder: Path) -> None:
    assert files(folder) == []


@pytest.mark.parametrize(
    ("function", "problem"),
    [
        (
            "corps:map_observation",
            ("there is no module corps: corps.py is not beside the FleetSpec", "did you mean `crops`?"),
        ),
        ("crops:map_observations", ("crops.py does not define map_observations", "did you mean `map_observation`?")),
        (
            "crops:evaluate",
            ("evaluate in crops.py cannot be called with one argument", "it is called with the observation"),
        ),
        ("crops:named", ("named in crops.py cannot be called with one argument", "it is called with the observation")),
        ("crops:later", ("later in crops.py is asynchronous, and is called as a plain function", "remove `async`")),
    ],
)
def test_functions_that_cannot_be_called(folder: Path, function: str, problem: tuple[str, str]) -> None:
    assert files(folder, map={"function": function}) == [("spec.map.function", *problem)]


@pytest.mark.parametrize(
    "function", ["crops:many", "crops:Mapper", "crops:mean", "crops:quick", "crops:LIMIT", "json:loads"]
)
def test_names_that_may_be_functions_are_taken(folder: Path, function: str) -> None:
    assert files(folder, map={"function": function}) == []


def test_eval_takes_two_arguments(folder: Path) -> None:
    assert files(folder, eval={"function": "crops:with_default"}) == []
    assert [found[0] for found in files(folder, eval={"function": "crops:map_observation"})] == ["spec.eval.function"]


def test_modules_in_packages_are_found_without_being_run(folder: Path) -> None:
    (folder / "farm").mkdir()
    (folder / "farm" / "__init__.py").write_text("raise RuntimeError('this was run')\n")
    (folder / "farm" / "crops.py").write_text("raise RuntimeError('this was run')\ndef see(observation): ...\n")
    assert files(folder, map={"function": "farm.crops:see"}) == []


def test_a_module_that_is_not_python_is_told_with_its_line(folder: Path) -> None:
    (folder / "crops.py").write_text("def map_observation(observation):\nreturn 1\n")
    message = files(folder)[0][1]
    assert message.startswith("crops.py, line 2: expected an indented block")


def test_a_module_that_imports_everything_may_define_anything(folder: Path) -> None:
    (folder / "crops.py").write_text("from elsewhere import *\n")
    assert files(folder) == []


def test_contexts_that_are_not_there(folder: Path) -> None:
    (folder / "contexts" / "june" / "context.yaml").unlink()
    (folder / "points.csv").write_text("row,col\n")
    use = [
        {"name": "a", "uri": "contexts/june", "use": ["Shaping"]},
        {"name": "b", "uri": "points.csv", "use": ["Training"]},
        {"name": "c", "uri": "contexts/augst", "use": ["Training"]},
        {"name": "d", "uri": "fields/north", "use": ["Training"]},
        {"name": "e", "uri": "hdfs://namenode/somewhere", "use": ["Training"]},
        {"name": "september", "uri": (folder / "contexts" / "september").as_uri(), "use": ["Mission"]},
    ]
    importing = "`fleet context import` makes a context of a CSV file"
    assert files(folder, contexts=use) == [
        (
            "spec.contexts[0].uri",
            "the folder contexts/june has no context.yaml, so it is not a context",
            importing,
        ),
        ("spec.contexts[1].uri", "points.csv is a file, and a context is a folder", importing),
        ("spec.contexts[2].uri", "there is no folder contexts/augst", "did you mean `august`?"),
        (
            "spec.contexts[3].uri",
            "there is no folder fields/north",
            "names are relative to the folder of the FleetSpec",
        ),
    ]


def test_models_and_profiles_that_are_not_there(folder: Path) -> None:
    found = files(
        folder,
        sa={"pretrained": "model.npz"},
        agents={"count": 1, "energyProfile": "profiles.yaml#mine"},
        workflow={"edgeProfile": "laptop-i5"},
    )
    assert [(path, message) for path, message, _ in found] == [
        ("spec.sa.pretrained", "there is no file model.npz"),
        ("spec.agents.energyProfile", "there is no file profiles.yaml"),
    ]


DOUBTFUL: list[tuple[dict[str, Any], str, str]] = [
    (
        {"contexts": [{"name": "september", "uri": "x", "use": ["Shaping", "Training", "Mission"]}]},
        "spec.contexts[0].use",
        '"september" is for Shaping and Training, and it is flown over too',
    ),
    (
        {
            "contexts": [
                {"name": "learn", "uri": "x", "use": ["Shaping", "Training"]},
                {"name": "september", "uri": "x", "use": ["Mission"]},
            ]
        },
        "spec.contexts[0].use",
        '"learn" is for Shaping and Training, and the same data, as "september", is flown over too',
    ),
    ({"sa": {"kind": "DQN"}}, "spec.sa.kind", "DQN needs the extra `deep`"),
    (
        {"sa": {"kind": "Planner"}, "ha": {"utilityThreshold": 3.0}},
        "spec.ha.utilityThreshold",
        "Planner does not look at utilityThreshold",
    ),
    (
        {"sa": {"kind": "Planner"}, "ha": {"visitedThreshold": 0, "caution": 0.5}},
        "spec.ha.visitedThreshold",
        "Planner does not look at visitedThreshold",
    ),
    ({"ha": {"caution": 0.0}}, "spec.ha.caution", "QLearning does not look at caution"),
    (
        {"sa": {"kind": "QLearning", "feature": "exg"}},
        "spec.sa.feature",
        "QLearning does not look at feature",
    ),
    (
        {"goals": [{"metric": "accuracy", "atLeast": 70}]},
        "spec.goals[0].atLeast",
        "accuracy is a share from 0 to 1 unless Eval() says otherwise, and this is 70",
    ),
    (
        {"agents": {"count": 6}, "scheduling": {"usefulness": "Absolute"}},
        "spec.scheduling.usefulness",
        "with 6 agents, Absolute puts nearly every model at level 0, where none is retrained",
    ),
    (
        {"missions": {"count": 3}, "onlineLearning": {"retraining": {"every": 5}}},
        "spec.onlineLearning.retraining.every",
        "models are retrained after every 5 missions, and there are only 3",
    ),
    (
        {"missions": {"count": 3}, "aggregation": {"pruning": {"below": 0.1, "after": 3}}},
        "spec.aggregation.pruning.after",
        "no model is pruned: that takes 3 missions, and there are only 3",
    ),
    (
        {"onlineLearning": {"replays": 0}},
        "spec.onlineLearning.replays",
        "MultiplicativeWeights learns from replays alone; without them every agent keeps its first model",
    ),
    (
        {"rewardShaping": {"epochs": 2}},
        "spec.rewardShaping.batch",
        "4 parameter sets are simulated side by side, and there are only 2 epochs",
    ),
    (
        {
            "agents": {
                "members": [{"name": name, "start": {"row": 1, "column": 2}} for name in ("scout", "mapper")],
            }
        },
        "spec.agents.members[1].start",
        "scout and mapper take off from the same cell (row 1, column 2)",
    ),
    ({"map": {"image": "farm/map"}}, "spec.map.image", "farm/map may be another program tomorrow"),
    (
        {"map": {"image": "host:5000/map:latest"}},
        "spec.map.image",
        "host:5000/map:latest may be another program tomorrow",
    ),
]


@pytest.mark.parametrize(("spec", "path", "message"), DOUBTFUL)
def test_doubtful_specs_are_taken_with_a_warning(spec: dict[str, Any], path: str, message: str) -> None:
    warnings = warnings_of(parse_fleet_spec(fleet_document(**spec)))
    assert [(warning.path, warning.message) for warning in warnings] == [(path, message)]


@pytest.mark.parametrize(
    "spec",
    [
        {"sa": {"kind": "Planner", "feature": "exg"}, "ha": {"caution": 0.5, "confidence": 0.8}},
        {},
        {"onlineLearning": {"replays": 0, "weights": "ExpectedImprovement"}},
        {"map": {"image": "host:5000/map:1.2"}},
        {"map": {"image": "farm/map@sha256:0123"}},
    ],
)
def test_ordinary_specs_have_no_warning(spec: dict[str, Any]) -> None:
    assert warnings_of(parse_fleet_spec(fleet_document(**spec))) == []


def test_a_loaded_spec_breaks_no_rule() -> None:
    assert check(parse_fleet_spec(fleet_document())) == []


def test_rules_can_be_checked_of_a_spec_made_in_python() -> None:
    spec = parse_fleet_spec(fleet_document())
    both = spec.spec.map.model_copy(update={"image": "farm/map:1.0"})
    broken = spec.model_copy(update={"spec": spec.spec.model_copy(update={"map": both})})
    assert [problem.path for problem in check(broken)] == ["spec.map"]


def test_examine_tells_problems_files_and_warnings_at_once(folder: Path) -> None:
    document = fleet_document(
        map={"function": "crops:see"},
        goals=[{"metric": "accuracy", "atLeast": 70}],
        missions={"count": 0, "seed": None},
    )
    path = folder / "fleet.yaml"
    path.write_text(write_yaml(document))
    found = examine(path)
    assert found.spec is None
    assert [str(problem) for problem in found.problems] == [
        "line 11: spec.map.function: crops.py does not define see; it defines mean, quick, LIMIT, map_observation, "
        "evaluate, with_default, many and named",
        "line 31: spec.missions.count: must be at least 1, and is 0",
    ]
    assert [str(warning) for warning in found.warnings] == [
        "line 29: spec.goals[0].atLeast: accuracy is a share from 0 to 1 unless Eval() says otherwise, and this is 70; "
        "write 0.7 for 70 %",
        "line 32: spec.missions.seed: has no value; write one, or remove the line",
    ]


def test_examine_gives_the_spec_when_it_is_good(folder: Path) -> None:
    path = folder / "fleet.yaml"
    path.write_text(write_yaml(fleet_document()))
    found = examine(path)
    assert (found.spec, found.problems, found.warnings) == (parse_fleet_spec(fleet_document()), (), ())


def test_examine_never_raises(tmp_path: Path) -> None:
    assert examine(tmp_path / "none.yaml").problems == (
        Problem("", f"{tmp_path / 'none.yaml'} cannot be read: no such file or directory"),
    )

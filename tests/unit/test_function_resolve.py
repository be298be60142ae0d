"""From `module:function` to the function, and its version."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

from fleet.errors import FunctionError
from fleet.functions.resolve import resolve, version_of

MODULE = """
import helper_of_scouting
from fleet.functions.compose import compose
from fleet.functions.extractors import blur, brightness
CONSTANT = 3
def measure(observation):
    return {"a": helper_of_scouting.scale(1.0)}
both = compose(brightness, measure)
one = compose(brightness)
other = compose(blur)
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "scouting_part.py").write_text(MODULE)
    (tmp_path / "helper_of_scouting.py").write_text("def scale(value):\n    return value\n")
    (tmp_path / "broken_part.py").write_text("x = 1\ny = x / 0\n")
    (tmp_path / "leaving_part.py").write_text("import sys\nsys.exit(3)\n")
    (tmp_path / "torn_part.py").write_text("def f(:\n")
    (tmp_path / "needy_part.py").write_text("import no_such_library\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path
    for name in ("scouting_part", "helper_of_scouting"):
        sys.modules.pop(name, None)


def test_a_function_is_found(folder: Path) -> None:
    assert resolve("scouting_part:measure")(None) == {"a": 1.0}


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        ("scouting_part", "scouting_part: is not a reference to a function; write `module:function`"),
        (
            "scouting_part:mesure",
            "scouting_part:mesure: module scouting_part has no 'mesure'; did you mean measure?",
        ),
        ("scouting_part:zzz", "scouting_part:zzz: module scouting_part has no 'zzz'; it has measure"),
        ("scouting_part:CONSTANT", "scouting_part:CONSTANT: 'CONSTANT' is a int, not a function"),
        (
            "broken_part:f",
            "broken_part:f: module broken_part raised ZeroDivisionError on import at line 2 of broken_part.py: "
            "division by zero",
        ),
        (
            "leaving_part:f",
            "leaving_part:f: module leaving_part raised SystemExit on import at line 2 of leaving_part.py: 3",
        ),
        (
            "torn_part:f",
            "torn_part:f: module torn_part raised SyntaxError on import at line 1 of torn_part.py: invalid syntax "
            "(torn_part.py, line 1)",
        ),
        (
            "needy_part:f",
            "needy_part:f: module needy_part imports 'no_such_library', which is not installed; install it, "
            "or use an image that has it",
        ),
    ],
)
def test_what_is_wrong_is_said(folder: Path, reference: str, message: str) -> None:
    with pytest.raises(FunctionError) as caught:
        resolve(reference)
    assert str(caught.value) == message


def test_a_module_that_is_not_there_says_where_it_was_looked_for(folder: Path) -> None:
    with pytest.raises(FunctionError) as caught:
        resolve("absent_part:f")
    assert str(caught.value).startswith(f"absent_part:f: there is no module 'absent_part'; looked in {folder}")
    assert "site-packages" not in str(caught.value)


def test_the_version_follows_the_module_and_what_it_uses_beside_it(folder: Path) -> None:
    before = version_of(resolve("scouting_part:measure"))
    assert before == version_of(resolve("scouting_part:measure"))
    (folder / "helper_of_scouting.py").write_text("def scale(value):\n    return 2 * value\n")
    after = version_of(resolve("scouting_part:measure"))
    (folder / "scouting_part.py").write_text(MODULE + "# changed\n")
    importlib.invalidate_caches()
    assert len({before, after, version_of(resolve("scouting_part:measure"))}) == 3


def test_the_version_follows_the_extractors(folder: Path) -> None:
    names = ("one", "other", "both")
    assert len({version_of(resolve(f"scouting_part:{name}")) for name in names}) == 3

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import Result

from fleet.cli.scaffold.field import made_up_field
from fleet.contexts.files import write_cube
from fleet.contexts.load import load_cube
from fleet.functions.vision import encode
from fleet.storage.local import LocalStorage

Invoke = Callable[..., Result]
TABLE = "row,col,exg,site\n0,0,10,a\n0,0,20,a\n0,1,30,b\n1,1,40,a\n"
SIZE = ("--cell-height", 5, "--cell-width", 4)


@pytest.fixture
def table(tmp_path: Path) -> Path:
    file = tmp_path / "june.csv"
    file.write_text(TABLE)
    return file


def test_import_averages_the_lines_of_a_cell_and_leaves_others_empty(
    invoke: Invoke, table: Path, tmp_path: Path
) -> None:
    done = invoke("context", "import", table, tmp_path / "june", "--date", "2018-06-01", *SIZE)
    assert done.exit_code == 0, done.output
    cube = load_cube(LocalStorage(tmp_path / "june"))
    assert cube.environment.name == "june"
    np.testing.assert_array_equal(cube.values("exg"), [[15.0, 30.0], [np.nan, 40.0]])
    checked = invoke("context", "check", tmp_path / "june")
    assert checked.exit_code == 0
    assert "is a good context" in checked.output


def test_import_keeps_to_the_lines_that_are_wanted(invoke: Invoke, table: Path, tmp_path: Path) -> None:
    done = invoke("context", "import", table, tmp_path / "june", "--date", "2018-06-01", *SIZE, "--where", "site=b")
    assert done.exit_code == 0, done.output
    assert np.nansum(load_cube(LocalStorage(tmp_path / "june")).values("exg")) == 30


def test_import_measures_pictures(invoke: Invoke, tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for column in range(3):
        green = np.full((4, 4, 3), (10, 60 + 40 * column, 20), dtype=np.uint8)
        (folder / f"{column}.png").write_bytes(encode(green))
    table = tmp_path / "pictures.csv"
    table.write_text("row,col,picture\n" + "".join(f"0,{column},{column}.png\n" for column in range(3)))
    options = ("--date", "2018", "--truth", "exg", "--pictures", folder)
    done = invoke("context", "import", table, tmp_path / "june", *options, *SIZE)
    assert done.exit_code == 0, done.output
    cube = load_cube(LocalStorage(tmp_path / "june"))
    np.testing.assert_allclose(cube.values("exg"), [[90.0, 170.0, 250.0]])
    assert not cube.renders


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("{table}", "{here}/June Field", "--date", "2018"), "small letters, digits and `-`"),
        (("{table}", "{here}/june"), "date"),
        (("{table}", "{here}/june", "--date", "2018", "--where", "exg"), "is not COLUMN=TEXT"),
        (("{table}", "{here}", "--date", "2018"), "is there already"),
        (("{here}/nothing.csv", "{here}/june"), "does not exist"),
    ],
)
def test_import_says_what_is_wrong(
    invoke: Invoke, table: Path, tmp_path: Path, arguments: tuple[str, ...], expected: str
) -> None:
    done = invoke("context", "import", *(text.format(table=table, here=tmp_path) for text in arguments))
    assert done.exit_code == 2
    assert expected in " ".join(done.output.split())
    assert not (tmp_path / "june").exists()


def test_check_of_a_bad_context_lists_every_problem(invoke: Invoke, tmp_path: Path) -> None:
    (tmp_path / "context.yaml").write_text("kind: AutonomyCube\nname: Bad Name\ndates: []\n")
    done = invoke("context", "check", tmp_path)
    assert done.exit_code == 2
    assert "grid" in done.output
    document = json.loads(invoke("context", "check", tmp_path, "--json").output)
    assert document["good"] is False
    assert len(document["problems"]) >= 3


def test_show_draws_a_map_and_tells_statistics(invoke: Invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_cube(made_up_field("field", 1), LocalStorage(tmp_path / "field"))
    monkeypatch.chdir(tmp_path)
    shown = invoke("context", "show", tmp_path / "field")
    assert shown.exit_code == 0
    Image.open(tmp_path / "field.png").verify()
    assert "144 of 144 cells" in shown.output
    document = json.loads(invoke("context", "show", tmp_path / "field", "--json", "--picture", "map.png").output)
    assert document["picture"] == "map.png"
    assert (tmp_path / "map.png").read_bytes() == (tmp_path / "field.png").read_bytes()
    assert [one["name"] for one in document["features"]] == ["exg"]


@pytest.mark.parametrize(
    ("option", "expected"), [(("--date", "1999"), "has nothing of 1999"), (("--feature", "lai"), "no feature 'lai'")]
)
def test_show_says_what_there_is(invoke: Invoke, tmp_path: Path, option: tuple[str, str], expected: str) -> None:
    write_cube(made_up_field("field", 1), LocalStorage(tmp_path / "field"))
    done = invoke("context", "show", tmp_path / "field", *option)
    assert done.exit_code == 2
    assert expected in done.output


def test_serve_answers_until_it_is_stopped(my_swarm: Path) -> None:
    root = Path(__file__).resolve().parents[3]
    process = subprocess.Popen(
        [sys.executable, "-m", "fleet.cli", "serve", "map", "my_swarm:map_observation", "--port", "0"],
        cwd=my_swarm.parent,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(root)},
    )
    with process:
        assert process.stderr is not None
        line = process.stderr.readline()
        assert "listening" in line, line
        address = line.split()[-1]
        with urllib.request.urlopen(f"{address}/describe", timeout=30) as answer:
            assert json.load(io.TextIOWrapper(answer))["features"] == ["exg", "soil"]
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=30) == 0


def test_serve_of_a_function_that_is_not_there_says_so(
    invoke: Invoke, my_swarm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(my_swarm.parent)
    assert invoke("serve", "map", "no_such_module:map_observation", "--port", 0).exit_code == 65
    assert invoke("serve", "map", "my_swarm:map_observation", "--timeout", "soon").exit_code == 2
    assert invoke("serve", "fly", "my_swarm:map_observation").exit_code == 2

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fleet.contexts.check import statistics_of
from fleet.contexts.cube import AutonomyCube
from fleet.contexts.files import write_cube
from fleet.contexts.load import load_cube
from fleet.contexts.manifest import RenderScale
from fleet.errors import ContextError
from fleet.functions.evaluation import truth_metrics
from fleet.functions.extractors import brightness, excess_green
from fleet.spec.swarm import Action
from fleet.storage.local import LocalStorage
from tests.context_builders import DATE, cells, manifest, pictured, plot

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples" / "crop-scouting" / "contexts"
CELLS_WITH_DATA = {"2018-06-01": 2106, "2018-08-02": 1278, "2018-09-16": 1787}


def test_the_grid_is_that_of_the_manifest() -> None:
    grid = AutonomyCube(plot()).environment.grid
    assert (grid.rows, grid.columns, grid.cell_height_m, grid.cell_width_m) == (3, 4, 10.0, 8.0)
    assert np.flatnonzero(~grid.valid).tolist() == [6]


def test_features_beside_the_picture_are_attributes() -> None:
    content = dataclasses.replace(
        plot(),
        manifest=manifest(("exg", "lat", "lon")),
        cells=cells([(0, 1)], {"exg": [20.0], "lat": [39.6], "lon": [np.nan]}),
    )
    assert AutonomyCube(content).observe(1).attributes == {"lat": 39.6, "rendered": 1.0}


def test_stored_pictures_are_given_as_they_are_and_others_are_drawn() -> None:
    cube = AutonomyCube(pictured())
    stored, drawn = cube.observe(0), cube.observe(11)
    assert cube.content.pictures is not None
    assert stored.media == (cube.content.pictures.media[0],)
    assert (stored.attributes["rendered"], drawn.attributes["rendered"]) == (0.0, 1.0)
    assert excess_green(drawn)["exg"] == pytest.approx(40.0, abs=0.01)
    assert cube.renders


def test_it_says_what_drawn_pictures_show() -> None:
    scaled = dataclasses.replace(
        plot(),
        manifest=manifest(("yield",), truth="yield", render=RenderScale(feature="yield", high=200.0)),
        cells=cells([(0, 1)], {"yield": [120.0]}),
    )
    assert AutonomyCube(plot()).remarks == ("plot: pictures are drawn from measured features, they show excess green",)
    assert AutonomyCube(scaled).remarks == (
        "plot: pictures are drawn from measured features, they show yield as excess green, 0 at 0 and 100 at 200",
    )


def test_a_scaled_truth_has_the_classes_of_the_quantity_itself() -> None:
    rng = np.random.default_rng(3)
    quantity = rng.uniform(60, 200, 12)
    positions = [(row, column) for row in range(3) for column in range(4)]
    content = dataclasses.replace(
        plot(),
        manifest=manifest(("yield",), truth="yield", render=RenderScale(feature="yield", high=200.0)),
        cells=cells(positions, {"yield": quantity.tolist()}),
    )
    cube = AutonomyCube(content)
    seen = np.array([excess_green(cube.observe(state))["exg"] for state in range(12)]).reshape(3, 4)
    assert cube.environment.truth is not None
    np.testing.assert_allclose(seen, cube.environment.truth, atol=0.01)
    guess = np.full((3, 4), quantity.mean())
    in_own_unit = dataclasses.replace(cube.environment, truth=cube.values("yield"))
    assert truth_metrics(guess / 2, cube.environment)["accuracy"] == truth_metrics(guess, in_own_unit)["accuracy"]


def test_an_unknown_feature_or_date_is_refused_by_name() -> None:
    cube = AutonomyCube(plot())
    with pytest.raises(ContextError, match="plot has no feature 'yield'; it has exg, brightness"):
        cube.values("yield")
    with pytest.raises(ContextError, match=f"plot has nothing of 2019; it was observed on {DATE}"):
        cube.at("2019")


def test_statistics_are_those_of_the_values() -> None:
    statistics = statistics_of(AutonomyCube(plot()))
    assert (statistics.with_data, statistics.cells, statistics.rendered) == (11, 12, True)
    assert [(one.name, one.missing, one.minimum, one.mean, one.maximum) for one in statistics.features] == [
        ("exg", 0, 10.0, 25.0, 40.0),
        ("brightness", 0, pytest.approx(0.6), pytest.approx(0.6), pytest.approx(0.6)),
    ]


@pytest.mark.parametrize("date", CELLS_WITH_DATA)
def test_map_sees_what_was_measured_in_every_cell_of_the_examples(date: str) -> None:
    cube = load_cube(LocalStorage(EXAMPLES / date))
    states = np.flatnonzero(cube.environment.grid.valid)
    assert len(states) == CELLS_WITH_DATA[date]
    observations = [cube.observe(state) for state in states.tolist()]
    exg = np.array([excess_green(observation)["exg"] for observation in observations])
    bright = np.array([brightness(observation)["brightness"] for observation in observations])
    np.testing.assert_allclose(exg, cube.values("exg").ravel()[states], atol=0.01)
    np.testing.assert_allclose(bright, cube.values("brightness").ravel()[states], atol=0.1 / 255)


@pytest.mark.parametrize("date", CELLS_WITH_DATA)
def test_the_examples_are_small_and_lie_as_their_positions_say(date: str) -> None:
    assert sum(file.stat().st_size for file in (EXAMPLES / date).iterdir()) < 300_000
    cube = load_cube(LocalStorage(EXAMPLES / date))
    grid = cube.environment.grid
    assert (grid.rows, grid.columns, grid.cell_height_m, grid.cell_width_m) == (56, 44, 11.9, 8.9)
    lat, lon = cube.values("lat"), cube.values("lon")
    assert np.nanmedian(np.diff(lat, axis=0)) < 0
    assert np.nanmedian(np.diff(lon, axis=1)) < 0
    assert grid.step(Action.NORTH) == (-1, 0)
    assert grid.step(Action.WEST) == (0, 1)


def test_the_examples_are_what_the_import_makes_of_their_source(shared_data: Path, tmp_path: Path) -> None:
    sys_path = str(EXAMPLES)
    code = (
        f"import sys, pathlib; sys.path.insert(0, {sys_path!r}); import make_contexts\n"
        f"make_contexts.HERE = pathlib.Path({str(tmp_path)!r})\n"
        f"make_contexts.main(pathlib.Path({str(shared_data / 'corn-cube')!r}))\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
    for date in CELLS_WITH_DATA:
        made, shipped = (load_cube(LocalStorage(folder / date)).environment.digest for folder in (tmp_path, EXAMPLES))
        assert made == shipped


def test_a_cube_is_written_with_context_yaml_last(tmp_path: Path) -> None:
    written: list[str] = []

    class Watched(LocalStorage):
        def write(self, path: str, data: bytes) -> None:
            written.append(path)
            super().write(path, data)

    write_cube(pictured(), Watched(tmp_path))
    assert written == ["features.parquet", "pictures.parquet", "context.yaml"]

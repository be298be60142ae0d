from __future__ import annotations

import io

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from fleet.contexts.grid import Grid
from fleet.report import figures, plots

RED_CHANNEL_OF_HIGH = 200
"""viridis ends in yellow and begins in dark violet: only high values have much red."""


def pixels(png: bytes) -> NDArray[np.uint8]:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def corner_of_the_greatest(grid: Grid) -> tuple[str, str]:
    """Where on the picture the cell at row 0, column 0 is, when it alone has the greatest value."""
    values = np.zeros((grid.rows, grid.columns))
    values[0, 0] = 1.0
    picture = pixels(plots.value_map(grid, values, figures.Scale("", 0.0, 1.0)))
    picture = picture[:, : int(picture.shape[1] * 0.75)]  # without the bar of colours
    bright = np.argwhere((picture[..., 0] > RED_CHANNEL_OF_HIGH) & (picture[..., 2] < 100))
    row, column = bright.mean(axis=0)
    return "north" if row < picture.shape[0] / 2 else "south", "west" if column < picture.shape[1] / 2 else "east"


@pytest.mark.parametrize(
    ("rows_go_south", "columns_go_east", "expected"),
    [
        (True, True, ("north", "west")),
        (False, True, ("south", "west")),
        (True, False, ("north", "east")),
        (False, False, ("south", "east")),
    ],
)
def test_north_is_up_and_east_is_right_on_every_map(
    rows_go_south: bool, columns_go_east: bool, expected: tuple[str, str]
) -> None:
    grid = Grid(np.ones((6, 6), dtype=np.bool_), 1.0, 1.0, rows_go_south, columns_go_east)
    assert corner_of_the_greatest(grid) == expected


def test_a_cell_has_its_true_proportions() -> None:
    wide = pixels(plots.path_map(Grid(np.ones((4, 4), dtype=np.bool_), 1.0, 4.0), None, []))
    high = pixels(plots.path_map(Grid(np.ones((4, 4), dtype=np.bool_), 4.0, 1.0), None, []))
    assert wide.shape[1] == high.shape[1]
    assert wide.shape[0] < high.shape[0] / 2


def test_equal_input_gives_equal_bytes() -> None:
    grid = Grid(np.ones((5, 7), dtype=np.bool_))
    track = figures.Track("agent-1", [0, 0, 1], [0, 1, 1])

    def draw() -> bytes:
        return plots.path_map(grid, np.arange(35.0).reshape(5, 7), [track])

    assert draw() == draw()


@pytest.mark.parametrize("agents", [0, 1, 4, 12, 13, 40])
def test_any_number_of_agents_can_be_drawn(agents: int) -> None:
    grid = Grid(np.ones((5, 50), dtype=np.bool_))
    tracks = [figures.Track(f"agent-{number}", [0, 1, 2], [number] * 3) for number in range(agents)]
    assert pixels(plots.path_map(grid, None, tracks)).shape[1] > 300


@pytest.mark.parametrize(
    "values", [np.full((3, 3), np.nan), np.zeros((3, 3)), np.full((3, 3), 1e300), np.array([[1.0]])]
)
def test_maps_without_any_contrast_can_be_drawn(values: NDArray[np.float64]) -> None:
    grid = Grid(np.ones(values.shape, dtype=np.bool_))
    for scale in (figures.value_scale("x", [values]), figures.error_scale("x", values)):
        assert pixels(plots.value_map(grid, values, scale)).size


def test_classes_have_one_colour_each() -> None:
    values = np.repeat(np.arange(4.0)[:, None], 4, axis=1)
    grid = Grid(np.ones((4, 4), dtype=np.bool_))
    picture = pixels(plots.value_map(grid, values, figures.class_scale("class", [values])))
    column = picture[:, picture.shape[1] // 3]
    colours = {tuple(colour) for colour in column.tolist()}
    assert len([colour for colour in colours if (column == colour).all(axis=1).sum() > 50]) >= 4


def test_a_scale_leaves_outliers_to_the_ends() -> None:
    values = np.append(np.linspace(0, 1, 1000), 1e6)
    scale = figures.value_scale("x", [values])
    assert (round(scale.low, 2), round(scale.high, 2)) == (0.01, 0.99)


def test_an_error_of_nothing_is_in_the_middle_of_its_scale() -> None:
    scale = figures.error_scale("x", np.array([-1.0, 0.0, 3.0]))
    assert scale.low == -scale.high


def test_models_without_any_usefulness_can_be_drawn() -> None:
    nothing = {1: [float("nan"), float("nan")]}
    assert pixels(plots.models_over_missions(["initial", "1"], nothing, {})).size


def test_many_missions_fit_into_one_picture() -> None:
    usefulness = {number: [0.5, 0.5] for number in range(1, 200)}
    assert pixels(plots.models_over_missions(["initial", "1"], usefulness, usefulness)).shape[1] < 2500

"""Built-in extractors on pictures whose answers are known, and on a real frame when it is there."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from fleet.contexts.base import Media, Observation
from fleet.contexts.render import Appearance, render
from fleet.functions.compose import compose
from fleet.functions.extractors import blur, brightness, canopy_cover, excess_green, leaf_area_index
from fleet.functions.stalks import plant_count
from fleet.functions.vision import decode, encode
from tests.pictures import PLANT, SOIL, half, observe, plain, planted

ALL = compose(excess_green, leaf_area_index, canopy_cover, plant_count, brightness, blur)


@pytest.mark.parametrize("suffix", [".png", ".ppm"])
@pytest.mark.parametrize(
    ("colour", "exg"),
    [((0, 255, 0), 510.0), ((255, 0, 255), -510.0), ((90, 90, 90), 0.0), ((10, 20, 4), 26.0)],
)
def test_excess_green_is_exact_on_one_colour(colour: tuple[int, int, int], exg: float, suffix: str) -> None:
    assert excess_green(observe(plain(*colour), suffix)) == {"exg": exg}


def test_excess_green_is_the_mean_over_all_pixels() -> None:
    rgb = np.random.default_rng(1).integers(0, 256, (33, 57, 3), dtype=np.uint8)
    wanted = (rgb.astype(float) @ [-1.0, 2.0, -1.0]).mean()
    assert excess_green(observe(rgb))["exg"] == pytest.approx(wanted, abs=1e-9)


def test_excess_green_survives_jpeg_to_a_level() -> None:
    assert excess_green(observe(half(64, 64), ".jpg"))["exg"] == pytest.approx(95.0, abs=1.0)


@pytest.mark.parametrize("exg", [-60.0, -11.9, 0.0, 24.95, 70.8, 120.0])
def test_excess_green_of_a_rendered_cell_is_the_measured_one(exg: float) -> None:
    picture = render(Appearance(exg=exg, brightness=0.6, seed=3))
    measured = excess_green(Observation(0, "", (picture,)))["exg"]
    assert measured == pytest.approx(exg, abs=0.5)


@pytest.mark.parametrize(("colour", "cover"), [(PLANT, 1.0), (SOIL, 0.0), ((0, 0, 0), 0.0), ((255, 255, 255), 0.0)])
def test_cover_of_one_colour_is_all_or_nothing(colour: tuple[int, int, int], cover: float) -> None:
    assert canopy_cover(observe(plain(*colour))) == {"cover": cover}


def test_cover_does_not_depend_on_exposure() -> None:
    assert [canopy_cover(observe((half() * light).astype(np.uint8)))["cover"] for light in (1.0, 0.5, 0.25)] == [
        0.5
    ] * 3


def test_leaf_area_follows_beer_and_lambert() -> None:
    assert leaf_area_index(observe(half()))["lai"] == pytest.approx(-math.log(0.5) / 0.5)
    assert leaf_area_index(observe(plain(*SOIL))) == {"lai": 0.0}
    assert leaf_area_index(observe(plain(*PLANT))) == {"lai": 10.0}


def test_brightness_is_luma() -> None:
    found = [brightness(observe(plain(*colour)))["brightness"] for colour in ((0, 0, 0), (255, 255, 255), (255, 0, 0))]
    assert found == pytest.approx([0.0, 1.0, 0.299])


def test_blur_is_zero_on_one_colour_and_falls_when_a_picture_is_smoothed() -> None:
    sharp = np.random.default_rng(2).integers(0, 256, (40, 40, 3), dtype=np.uint8)
    smooth = sharp.copy()
    smooth[1:-1, 1:-1] = np.mean([sharp[1:-1, :-2], sharp[1:-1, 2:], sharp[:-2, 1:-1], sharp[2:, 1:-1]], axis=0)
    assert blur(observe(plain(9, 9, 9))) == {"blur": 0.0}
    assert blur(observe(smooth))["blur"] < blur(observe(sharp))["blur"] / 2


@pytest.mark.parametrize("degrees", [0.0, 90.0, 45.0, 30.0, -50.0, 7.0])
@pytest.mark.parametrize(("side", "row_px", "plant_px"), [(48, 12.0, 6.0), (96, 24.0, 8.0), (240, 30.0, 10.0)])
def test_planted_plants_are_counted(side: int, row_px: float, plant_px: float, degrees: float) -> None:
    picture, planted_plants = planted(side, row_px, plant_px, degrees)
    counted = plant_count(observe(picture))["plants"]
    assert counted == pytest.approx(planted_plants, abs=max(1, 0.05 * planted_plants))


@pytest.mark.parametrize("picture", [plain(*SOIL), plain(0, 0, 0), plain(*SOIL, 1, 1), plain(200, 30, 30, 48, 48)])
def test_nothing_green_has_no_plants(picture: np.ndarray) -> None:
    assert plant_count(observe(picture)) == {"plants": 0.0}


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 60), (60, 1), (2, 3), (700, 5)])
def test_every_extractor_takes_odd_sizes(height: int, width: int) -> None:
    ssv = ALL(observe(plain(*PLANT, height, width)))
    assert all(math.isfinite(value) for value in ssv.values())
    assert list(ssv) == ["exg", "lai", "cover", "plants", "brightness", "blur"]


def test_every_value_is_in_its_declared_range() -> None:
    assert ALL.declared is not None
    generator = np.random.default_rng(5)
    pictures = [generator.integers(0, 256, (48, 48, 3), dtype=np.uint8) for _ in range(5)] + [half(), plain(0, 255, 0)]
    for picture in pictures:
        ssv = ALL(observe(picture))
        assert all(feature.low <= ssv[feature.name] <= feature.high for feature in ALL.declared)


def test_extractors_still_answer_what_their_version_says() -> None:
    # When this fails on purpose, raise EXTRACTOR_VERSION in fleet/functions/resolve.py: cached SSVs are stale then.
    y, x = np.mgrid[:48, :48]
    picture = np.stack(((7 * x + 3 * y) % 256, (5 * x * y + 11 * y) % 256, (2 * x + 13 * y) % 256), axis=2)
    assert ALL(observe(picture.astype(np.uint8))) == pytest.approx(
        {
            "exg": 5.88888889,
            "lai": 1.17245077,
            "cover": 0.443576389,
            "plants": 5.0,
            "brightness": 0.486847168,
            "blur": 41834.558,
        },
        rel=1e-6,
    )


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "0 bytes that start with b'' are not a picture that can be decoded; use PPM, PNG or JPEG"),
        (b"P6\n9", "4 bytes that start with b'P6\\n9' are not a picture that can be decoded; use PPM, PNG or JPEG"),
    ],
)
def test_garbage_is_no_picture(data: bytes, message: str) -> None:
    with pytest.raises(ValueError, match="are not a picture") as caught:
        decode(data)
    assert str(caught.value) == message


def test_a_torn_picture_is_a_clear_error_or_a_picture() -> None:
    whole = encode(plain(1, 2, 3, 64, 64))
    for end in range(0, len(whole), 7):
        try:
            picture = decode(whole[:end])
        except ValueError as error:
            assert "picture" in str(error)  # noqa: PT017  # either outcome is right
        else:
            assert (picture.height, picture.width) == (64, 64)


def test_an_observation_without_picture_says_what_it_has() -> None:
    with pytest.raises(ValueError, match="no picture") as caught:
        excess_green(Observation(1, "", (Media("text/plain", b"x"),)))
    assert str(caught.value) == "the observation has no picture; its media are: text/plain"


@pytest.fixture(scope="module")
def frame(shared_data: Path) -> np.ndarray:
    """Pixels of the frame, uint8 [3456, 4536, 3] in red, green, blue."""
    path = shared_data / "corn-images" / "london_frame_163053.jpg"
    if not path.exists():
        pytest.skip(f"there is no {path}")
    return decode(path.read_bytes()).bgr[:, :, ::-1]


class TestLondonFrame:
    """A real frame of corn before harvest: closed canopy, rows at some 57 degrees, 42 x 32 cells of 108 pixels."""

    def test_the_whole_frame_is_one_picture(self, frame: np.ndarray) -> None:
        ssv = ALL(observe(frame))
        wanted = (frame.reshape(-1, 3).mean(axis=0) @ [-1.0, 2.0, -1.0]).item()
        assert frame.shape == (3456, 4536, 3)
        assert ssv["exg"] == pytest.approx(wanted, abs=1e-6)
        assert (0.5 < ssv["cover"] < 1.0, 1.0 < ssv["lai"] < 10.0, 0.3 < ssv["brightness"] < 0.7) == (True, True, True)
        assert 2000 < ssv["plants"] < 20000

    def test_cells_are_green_and_their_mean_is_the_frames(self, frame: np.ndarray) -> None:
        cells = frame.reshape(32, 108, 42, 108, 3).swapaxes(1, 2).reshape(-1, 108, 108, 3)
        some = [excess_green(observe(cell))["exg"] for cell in cells]
        assert np.mean(some) == pytest.approx(excess_green(observe(frame))["exg"], abs=1e-6)
        assert np.mean(np.array(some) > 20) > 0.95

"""Pictures that are drawn from features show these features."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fleet.contexts.base import Media
from fleet.contexts.render import MEDIA_TYPE, SIZE, Appearance, cover, render
from fleet.contexts.render import _noise as noise
from fleet.randomness import GOLDEN_GAMMA, mix

appearances = st.builds(
    Appearance,
    exg=st.floats(-400, 400),
    brightness=st.floats(0, 1),
    tint=st.floats(-255, 255),
    seed=st.integers(0, 10_000),
)
of_fields = st.builds(
    Appearance,
    exg=st.floats(-22, 99),
    brightness=st.floats(0.5, 0.95),
    tint=st.floats(0, 80),
    seed=st.integers(0, 10_000),
)


def pixels(media: Media) -> NDArray[np.int64]:
    header, size, depth, data = media.data.split(b"\n", 3)
    assert (media.type, header, size, depth) == (MEDIA_TYPE, b"P6", f"{SIZE} {SIZE}".encode(), b"255")
    return np.frombuffer(data, dtype=np.uint8).astype(np.int64).reshape(SIZE, SIZE, 3)


def excess_green(picture: NDArray[np.int64]) -> float:
    red, green, blue = picture.reshape(-1, 3).mean(axis=0)
    return float(2 * green - red - blue)


def luma(picture: NDArray[np.int64]) -> float:
    return float(picture.reshape(-1, 3).mean(axis=0) @ [0.299, 0.587, 0.114]) / 255


@settings(max_examples=300)
@given(appearances)
def test_excess_green_is_met_wherever_it_can_be_drawn(look: Appearance) -> None:
    assert excess_green(pixels(render(look))) == pytest.approx(look.exg, abs=0.01)


@settings(max_examples=200)
@given(of_fields)
def test_fields_show_their_excess_green_their_brightness_and_their_plants(look: Appearance) -> None:
    picture = pixels(render(look))
    assert excess_green(picture) == pytest.approx(look.exg, abs=0.01)
    assert luma(picture) == pytest.approx(look.brightness, abs=0.1 / 255)
    if look.brightness < 0.85:  # in a picture that is nearly white plants may be as bright as soil
        red, green, blue = np.moveaxis(picture, 2, 0)
        plants = float(np.mean(15 * green - 12 * red - 5 * blue > 0))  # ExG - ExR > 0
        assert plants == pytest.approx(cover(look.exg), abs=0.05)


@given(of_fields)
@settings(max_examples=50)
def test_the_same_cell_is_always_drawn_the_same(look: Appearance) -> None:
    assert render(look) == render(look)


def test_cells_of_the_same_look_are_not_the_same_picture() -> None:
    assert render(Appearance(40.0, seed=1)) != render(Appearance(40.0, seed=2))


def test_noise_is_the_librarys_own_generator() -> None:
    seed = 2**64 - 12345
    expected = [mix((seed + index * GOLDEN_GAMMA) % 2**64) for index in range(1, 6)]
    assert noise(seed, 5).tolist() == expected


def test_pictures_change_only_with_the_render_version() -> None:
    looks = [Appearance(11.7, 0.89, 20.0, 7), Appearance(66.1, 0.65, 45.0, 8), Appearance(-11.9, 0.59, 53.0, 9)]
    digests = [hashlib.blake2b(render(look).data, digest_size=8).hexdigest() for look in looks]
    assert digests == [
        "075e1c951e45e366",
        "afa012f460326e47",
        "c4bbe09d5d2b3c2c",
    ]  # a failure here means: raise RENDER_VERSION, then write the new digests

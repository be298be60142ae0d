"""Pictures drawn from measured features, for contexts whose pictures are not there.

The picture shows crop rows with plants on soil. Its mean excess green and its mean brightness (luma of ITU-R BT.601,
as the built-in extractors measure them) are the measured ones; where the two leave colour open, the difference of red
and blue is the measured one or that of dry soil. What is drawn depends on the numbers given and on nothing else.
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Media
from fleet.randomness import GOLDEN_GAMMA, MIX_1, MIX_2

RENDER_VERSION = "1"
"""Changes whenever the same features may give another picture."""
MEDIA_TYPE = "image/x-portable-pixmap"
SIZE = 48
"""Pixels a side."""
DEFAULT_BRIGHTNESS = 0.6
DEFAULT_TINT = 30.0

_RED, _GREEN, _BLUE = 0.299, 0.587, 0.114  # luma of ITU-R BT.601
_ROW_PX, _PLANT_PX = 12, 8
_SOIL_EXG, _CANOPY_EXG = -20.0, 100.0
_LEAST_COVER, _MOST_COVER = 0.04, 0.96
_CONTRAST = np.array([-54.0, 6.0, -48.0])
"""Colour of plants less that of soil, in red, green and blue; 114 of excess green."""
_TEXTURE = 7


@dataclass(frozen=True)
class Appearance:
    """What a cell looks like from above.

    Args:
        exg: Mean of 2G - R - B, in grey levels.
        brightness: Mean luma over full scale, 0..1.
        tint: Mean of R - B, in grey levels.
        seed: Tells cells of the same look apart.
    """

    exg: float
    brightness: float = DEFAULT_BRIGHTNESS
    tint: float = DEFAULT_TINT
    seed: int = 0


def render(look: Appearance) -> Media:
    """Draw a cell as a binary PPM of SIZE x SIZE pixels.

    Excess green is met as long as it is in -400..400; brightness then gives way where both cannot be met.
    """
    mean = mean_colour(look)
    pattern = _pattern(_seed(look))
    plants = max(1, round(cover(look.exg) * pattern.size))
    is_plant = np.zeros(pattern.size, dtype=np.bool_)
    is_plant[np.argsort(pattern.ravel(), kind="stable")[:plants]] = True
    share = plants / pattern.size
    texture = _noise(_seed(look) ^ 1, pattern.size) % np.uint64(2 * _TEXTURE + 1)
    grey = texture.astype(np.int64) - _TEXTURE
    deviation = (is_plant[:, None] - share) * _CONTRAST + (grey - grey.sum() / grey.size)[:, None]
    pixels = _quantised(mean, mean + deviation * _room(mean, deviation))
    header = f"P6\n{SIZE} {SIZE}\n255\n".encode()
    return Media(MEDIA_TYPE, header + pixels.tobytes())


def cover(exg: float) -> float:
    """Share of the pixels that are plants: linear in excess green, from bare soil to closed canopy."""
    share = (exg - _SOIL_EXG) / (_CANOPY_EXG - _SOIL_EXG)
    return min(max(share, _LEAST_COVER), _MOST_COVER)


def mean_colour(look: Appearance) -> NDArray[np.float64]:
    """Mean red, green and blue, 0..255, that have the wanted excess green, and as far as possible the rest, [3].

    With d = R - B and luma L: B = L - b d - g E / 2, R = B + d, G = B + (E + d) / 2, b and g from the luma's weights.
    """
    exg = min(max(look.exg, -400.0), 400.0)
    luma = min(max(look.brightness, 0.0), 1.0) * 255.0
    down = _RED + _GREEN / 2
    level = luma - _GREEN / 2 * exg
    tints = (_tint_within(look.tint, level, exg, headroom) for headroom in (1.0, 0.5, 0.0))
    tint = next((tint for tint in tints if tint is not None), 0.0)
    blue = level - down * tint
    colour = np.array([blue + tint, blue + (exg + tint) / 2, blue])
    # A shift of all three keeps the excess green; it costs brightness.
    colour += max(0.0, -float(colour.min()))
    colour -= max(0.0, float(colour.max()) - 255.0)
    return np.asarray(np.clip(colour, 0.0, 255.0), dtype=np.float64)


def _tint_within(wanted: float, level: float, exg: float, headroom: float) -> float | None:
    """The tint nearest to the wanted one that leaves every channel in range; None when there is none.

    Args:
        wanted: Mean of R - B.
        level: R and B of a picture without tint.
        exg: Excess green.
        headroom: Share of the soil's excess over the mean that must fit below 255.
    """
    slopes = (1 - _RED - _GREEN / 2, 0.5 - _RED - _GREEN / 2, -(_RED + _GREEN / 2))
    soil = -cover(exg) * _CONTRAST + _TEXTURE
    low, high = -255.0, 255.0
    for value, slope, excess in zip((level, level + exg / 2, level), slopes, soil.tolist(), strict=True):
        top = 255.0 - headroom * max(0.0, excess)
        ends = sorted((-value / slope, (top - value) / slope))
        low, high = max(low, ends[0]), min(high, ends[1])
    return min(max(wanted, low), high) if low <= high else None


def _room(mean: NDArray[np.float64], deviation: NDArray[np.float64]) -> NDArray[np.float64]:
    """The largest factors, at most 1, by which pixels may differ from the mean and stay in 0..255, for each channel."""
    above, below = deviation.max(axis=0), -deviation.min(axis=0)
    return np.asarray(np.minimum(1.0, np.minimum((255.0 - mean) / above, mean / below)), dtype=np.float64)


def _quantised(mean: NDArray[np.float64], pixels: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Whole numbers whose mean is the wanted one to half a level of one pixel: the largest remainders go up."""
    whole = np.floor(np.clip(pixels, 0.0, 255.0))
    remainder = pixels - whole
    for channel in range(3):
        missing = round(float(mean[channel]) * len(pixels) - float(whole[:, channel].sum()))
        upward = np.argsort(-remainder[:, channel], kind="stable")[: max(0, missing)]
        whole[upward, channel] += 1
    return np.clip(whole, 0, 255).astype(np.uint8)


def _pattern(seed: int) -> NDArray[np.float64]:
    """Squared distance of each pixel to the nearest plant, [SIZE, SIZE]; plants stand in rows, not quite evenly."""
    down = np.arange(_ROW_PX // 2, SIZE, _ROW_PX)
    along = np.arange(_PLANT_PX // 2, SIZE, _PLANT_PX)
    jitter = (_noise(seed, 2 * down.size * along.size) >> np.uint64(11)).astype(np.float64) * 2.0**-53 - 0.5
    rows = np.repeat(down, along.size) + 2.0 * jitter[: jitter.size // 2]
    columns = np.tile(along, down.size) + 4.0 * jitter[jitter.size // 2 :]
    pixel = np.arange(SIZE)
    vertical = (pixel[:, None] - rows) ** 2
    horizontal = (pixel[:, None] - columns) ** 2
    nearest: NDArray[np.float64] = (vertical[:, None, :] + horizontal[None, :, :]).min(axis=2)
    return nearest


def _seed(look: Appearance) -> int:
    packed = struct.pack("<3dq", look.exg, look.brightness, look.tint, look.seed)
    return int.from_bytes(hashlib.blake2b(packed, digest_size=8).digest(), "little")


def _noise(seed: int, count: int) -> NDArray[np.uint64]:
    """`fleet.randomness.mix` over a counter, many at a time, uint64 [count]."""
    with np.errstate(over="ignore"):  # arithmetic modulo 2^64 is meant
        value = np.uint64(seed) + np.arange(1, count + 1, dtype=np.uint64) * np.uint64(GOLDEN_GAMMA)
        value = (value ^ (value >> np.uint64(30))) * np.uint64(MIX_1)
        value = (value ^ (value >> np.uint64(27))) * np.uint64(MIX_2)
    mixed: NDArray[np.uint64] = value ^ (value >> np.uint64(31))
    return mixed

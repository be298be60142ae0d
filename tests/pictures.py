"""Pictures of plants with known answers, for tests."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Media, Observation
from fleet.functions.vision import encode

SOIL = (120, 95, 70)
PLANT = (70, 160, 60)


def observe(rgb: NDArray[np.uint8], suffix: str = ".png") -> Observation:
    """An observation of one picture, uint8 [height, width, 3] in red, green, blue."""
    kinds = {".png": "image/png", ".jpg": "image/jpeg", ".ppm": "image/x-portable-pixmap"}
    return Observation(0, "cell 0", (Media(kinds[suffix], encode(np.ascontiguousarray(rgb[:, :, ::-1]), suffix)),))


def plain(red: int, green: int, blue: int, height: int = 8, width: int = 8) -> NDArray[np.uint8]:
    """A picture of one colour."""
    return np.full((height, width, 3), (red, green, blue), dtype=np.uint8)


def half(height: int = 8, width: int = 8) -> NDArray[np.uint8]:
    """Left half plant, right half soil."""
    picture = plain(*SOIL, height, width)
    picture[:, : width // 2] = PLANT
    return picture


def planted(
    side: int, row_px: float, plant_px: float, degrees: float = 0.0, seed: int = 0
) -> tuple[NDArray[np.uint8], int]:
    """Round plants on rows over soil, a tenth of them missing, and how many stand wholly in the picture.

    Args:
        side: Pixels a side.
        row_px, plant_px: Between rows, and between plants in a row.
        degrees: Direction of the rows, counter-clockwise.
    """
    generator = np.random.default_rng(seed)
    radius, angle = 0.36 * plant_px, math.radians(degrees)
    y, x = np.mgrid[:side, :side].astype(float)
    soft = np.zeros((side, side))
    count = 0
    reach = math.ceil(side / plant_px) + 1
    for row in range(-reach, reach):
        for place in range(-reach, reach):
            along = (place + 0.5) * plant_px + generator.uniform(-0.1, 0.1) * plant_px
            across = (row + 0.5) * row_px
            cx = side / 2 + along * math.cos(angle) + across * math.sin(angle)
            cy = side / 2 - along * math.sin(angle) + across * math.cos(angle)
            inside = all(radius + 1 <= c < side - radius - 1 for c in (cx, cy))
            if not inside or generator.random() < 0.1:
                continue
            count += 1
            soft = np.maximum(soft, np.clip(radius + 0.5 - np.hypot(x - cx, y - cy), 0, 1))
    colour = np.array(SOIL) + soft[:, :, None] * (np.array(PLANT) - np.array(SOIL))
    noisy = colour + generator.normal(0, 4, colour.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8), count

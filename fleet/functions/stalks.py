"""Count of plants (stalks) that stand in rows, seen from above.

1. The picture's plants are a signal: 15 G - 12 R - 5 B where positive.
2. Rows: of all directions, take the one across which the projection of the signal varies most.
3. Along each row, between the valleys to its neighbours, count the peaks that stand out from the valleys beside them.

A picture over 480 pixels is cut in tiles, so that rows may bend and the scale may change over a frame. On bare or young
fields this counts plants; under a closed canopy it counts the crowns that can be told apart, a proxy that grows with
the stand.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Observation
from fleet.functions.compose import Feature, extractor
from fleet.functions.contract import SSV
from fleet.functions.vision import picture_of, rotate, shrink

Signal = NDArray[np.float32]

TILE_PX = 480
_SEARCH_PX = 96
"""Side of the picture in which the direction of the rows is searched."""
_SHARE = 0.25
"""A peak stands out when it is this share of the strongest row's peak above the valleys beside it."""


@extractor(Feature("plants", "plants", 0.0))
def plant_count(observation: Observation) -> SSV:
    """Plants that can be told apart along the rows of the picture; 0 where nothing is green.

    Source: rows by the projection of the vegetation mask as in Gee et al. 2008, Computers and Electronics in
    Agriculture 60(1); plants as peaks along a row as in Shrestha and Steward 2003, Transactions of the ASAE 46(2).
    """
    plantness = picture_of(observation).plantness
    plants = 0
    for top, bottom in _cuts(plantness.shape[0]):
        for left, right in _cuts(plantness.shape[1]):
            tile = np.maximum(plantness[top:bottom, left:right], 0)
            plants += count_on_rows(tile.astype(np.float32)) if tile.any() else 0
    return {"plants": float(plants)}


def count_on_rows(signal: Signal) -> int:
    """Plants in a signal, float32 [height, width], that is 0 on soil and positive on plants."""
    degrees = row_direction(signal)
    lines = signal if degrees == 0 else rotate(signal, -degrees, 0.0)
    across = _smoothed(lines.sum(axis=1, dtype=np.float64) / _lengths(*signal.shape, degrees))
    rows = peaks(across, _SHARE * float(across.max()))
    if not rows:
        return 0
    width = _row_width(across, rows)
    along = [_along(lines, row, width) for row in rows]
    step = _SHARE * max(float(row.max()) for row in along)
    return sum(len(peaks(row, step)) for row in along)


def row_direction(signal: Signal) -> float:
    """Angle of the rows in degrees, 0 for rows along the picture's rows of pixels, counter-clockwise, -90..90.

    The direction whose projection explains most of the signal's variance, to 2.5 degrees.
    """
    height, width = signal.shape
    scale = min(1.0, _SEARCH_PX / max(height, width))
    small = shrink(signal, max(1, round(height * scale)), max(1, round(width * scale))) if scale < 1 else signal
    flat = small.reshape(-1).astype(np.float64)
    flat = flat - flat.mean()

    def explained(degrees: float) -> float:
        bins, counts = _projection(*small.shape, degrees)
        return float((np.bincount(bins, flat, len(counts)) ** 2 / counts).sum())

    best = max(np.arange(-90.0, 90.0, 10.0).tolist(), key=explained)
    for step in (5.0, 2.5):
        best = max((best, best - step, best + step), key=explained)
    return float((best + 90.0) % 180.0 - 90.0)


@lru_cache(maxsize=256)  # pictures of a mission have one size: the directions are the same for all
def _projection(height: int, width: int, degrees: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For every pixel the line of one pixel's width that it lies on, and the number of pixels of each line."""
    angle = math.radians(degrees)
    y, x = np.mgrid[:height, :width]
    place = np.rint(y * math.cos(angle) + x * math.sin(angle)).astype(np.int64).reshape(-1)
    bins = place - place.min()
    return bins, np.maximum(np.bincount(bins), 1)


def peaks(values: NDArray[np.floating], step: float) -> list[int]:
    """Places of the peaks that rise and fall by more than `step`; both ends count as valleys of height 0.

    A rise counts from the lowest value since the last peak; a flat top is one peak.
    """
    padded = np.concatenate(([0.0], np.asarray(values, dtype=np.float64), [0.0]))
    turns = np.flatnonzero(np.diff(np.sign(_slopes(padded)))) + 1
    found: list[int] = []
    low, high, place, rising = 0.0, 0.0, 0, True
    for index in [*turns.tolist(), len(padded) - 1]:
        value = float(padded[index])
        if rising and value > high:
            high, place = value, index
        if rising and high - low > step and high - value > step:
            found.append(place - 1)
            rising, low = False, value
        low = min(low, value) if not rising else low
        if not rising and value - low > step:
            rising, high, place = True, value, index
    return found


def _slopes(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Differences, with those of a flat stretch replaced by the one before it."""
    slopes = np.diff(values)
    last = np.maximum.accumulate(np.where(slopes != 0, np.arange(len(slopes)), 0))
    return np.asarray(slopes[last])


@lru_cache(maxsize=256)
def _lengths(height: int, width: int, degrees: float) -> NDArray[np.float64]:
    """Pixels of the picture on each line of the turned picture; at least a quarter of the longest line."""
    if degrees == 0:
        return np.full(height, float(width))
    lengths = rotate(np.ones((height, width), dtype=np.float32), -degrees, 0.0).sum(axis=1, dtype=np.float64)
    return np.asarray(np.maximum(lengths, lengths.max() / 4))


def _smoothed(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weighted mean of three neighbours, to a quarter, a half and a quarter."""
    return np.asarray(np.convolve(np.concatenate((values[:1], values, values[-1:])), [0.25, 0.5, 0.25], "valid"))


def _row_width(across: NDArray[np.float64], rows: list[int]) -> int:
    """Lines on each side of a row's middle that belong to it: a third of the way to the next row."""
    if len(rows) == 1:
        return max(1, int(np.count_nonzero(across > across.max() / 2)) // 2)
    return max(1, int(np.median(np.diff(rows))) // 3)


def _along(lines: Signal, row: int, width: int) -> NDArray[np.float64]:
    """Signal along a row, slightly smoothed."""
    band = lines[max(0, row - width) : row + width + 1].sum(axis=0, dtype=np.float64)
    return _smoothed(band)


def _cuts(length: int) -> list[tuple[int, int]]:
    parts = math.ceil(length / TILE_PX)
    ends = [round(length * part / parts) for part in range(parts + 1)]
    return list(pairwise(ends))

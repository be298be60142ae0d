"""A small made-up field as a context: smooth patches of good and poor growth, the same for the same seed."""

from __future__ import annotations

import math

import numpy as np

from fleet.contexts.cells import Cells, CubeContent
from fleet.contexts.manifest import CubeManifest, FeatureSpec, GridSpec
from fleet.randomness import uniform

ROWS = COLUMNS = 12
DATE = "2025-06-01"
_WAVES = 4
_MEAN_EXG, _SPREAD_EXG = 45.0, 12.0


def made_up_field(name: str, seed: int) -> CubeContent:
    """An autonomy cube of 12 x 12 cells of 10 m with one feature, `exg`, which pictures are drawn from."""
    rows, columns = np.divmod(np.arange(ROWS * COLUMNS, dtype=np.int64), COLUMNS)
    growth = np.zeros(len(rows))
    for wave in range(_WAVES):
        direction, phase = (2 * math.pi * uniform(seed, wave, draw) for draw in range(2))
        length = 6.0 + 8.0 * uniform(seed, wave, 2)
        along = rows * math.sin(direction) + columns * math.cos(direction)
        growth += np.sin(2 * math.pi * along / length + phase)
    growth += [0.6 * uniform(seed, _WAVES, cell) for cell in range(len(rows))]
    exg = _MEAN_EXG + _SPREAD_EXG * (growth - growth.mean()) / growth.std()
    manifest = CubeManifest(
        name=name,
        description="A small field that was made up, to try things on.",
        source="made by fleet init",
        licence="Apache-2.0",
        dates=(DATE,),
        grid=GridSpec(rows=ROWS, columns=COLUMNS, cell_height_m=10.0, cell_width_m=10.0),
        truth="exg",
        features=(FeatureSpec(name="exg", unit="grey levels", description="Excess green."),),
    )
    dates = np.full(len(rows), DATE)
    return CubeContent(manifest, Cells(rows, columns, dates, {"exg": exg.astype(np.float32).astype(np.float64)}))

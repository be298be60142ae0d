"""Kriging with external drift: how far a field follows what was expected of it before anything was captured.

What is expected comes from earlier missions over the same place. The field is taken as a slope times that, plus a rest
that is kriged; an offset needs no name, since ordinary kriging does not ask for a mean. The slope is a least squares
line through the captured cells, drawn towards 0 as far as it may be chance: an expectation that has become worthless
does no harm.

Source: Chiles and Delfiner 2012, Geostatistics, section 3.4 (external drift); Stein 1956, James and Stein 1961 for the
shrinkage, in the form c = 1 - 1 / F.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]

ALIKE = 4.0
"""Captured cells lie on paths, beside each other: so many of them say as much as one that stands alone."""
_FEW = 12
"""With fewer captured cells a slope means nothing."""


def slope(values: Values, expected: Values) -> float:
    """How much a field rises where what was expected rises by 1.

    Args:
        values: Of the captured cells, float64 [n].
        expected: Of the same cells, float64 [n].

    Returns:
        0 with fewer than 12 cells, and where chance would explain the slope.
    """
    if len(values) < _FEW:
        return 0.0
    found, said = values - values.mean(), expected - expected.mean()
    varied, total = float(said @ said), float(found @ found)
    if varied <= 0.0 or total <= 0.0:
        return 0.0
    line = float(said @ found) / varied
    explained = line * line * varied
    rest = max(total - explained, 0.0)
    by_chance = rest / (explained * max(len(values) / ALIKE - 2.0, 1.0)) if explained > 0.0 else np.inf
    return line * max(0.0, 1.0 - by_chance)

"""What missions spend until their map meets a goal."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bench.scouting.fields import Field
from bench.scouting.flight import Flights
from bench.scouting.judge import How, along, progress

Spent = tuple[float, float, float]


def ends(place: Field, flights: Flights, goals: Sequence[float], hows: Sequence[How]) -> dict[tuple[float, How], Spent]:
    """What a mission spends until its map meets each goal.

    Returns:
        Share of the cells, E, and time in s with the landing; NaN where it never does.
    """
    curve = along(place, flights, hows)
    spent, _ = progress(place, flights)
    times_s = np.sort(np.concatenate([flight.time_s for flight in flights]))
    found = {}
    for goal in goals:
        for how in hows:
            energy, cells = curve.reached(goal, how)
            if not math.isfinite(energy):
                found[goal, how] = (math.nan, math.nan, math.nan)
                continue
            at = min(int(np.searchsorted(spent, energy)), len(times_s) - 1)
            found[goal, how] = cells, energy, float(times_s[at]) + flights[0].landing_s
    return found

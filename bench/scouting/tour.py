"""A short path through some cells: nearest neighbour, then 2-opt and Or-opt until neither helps.

The path begins and ends where it likes; its length is the energy of straight moves. Source: Bentley 1992, Fast
algorithms for geometric traveling salesman problems.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bench.scouting.flight import move_costs
from fleet.contexts.grid import Grid

Cells = NDArray[np.int64]
_LONGEST_RUN = 3
"""Longest run of stops that Or-opt moves."""


def tour(grid: Grid, stops: Cells) -> Cells:
    """The stops in a good order, int64 [n].

    Args:
        stops: Different cells, int64 [n].
    """
    if len(stops) < 3:
        return stops
    places = _places(grid, stops)
    order = _nearest(places, int(places.sum(axis=1).argmin()))
    while _two_opt(places, order) or _or_opt(places, order):
        pass
    return np.asarray(stops[order])


def length_j(grid: Grid, stops: Cells) -> float:
    """Energy of straight moves through the stops in their order; the mean of to and fro."""
    return float(np.abs(np.diff(_places(grid, stops), axis=0)).sum())


def _places(grid: Grid, stops: Cells) -> NDArray[np.float64]:
    """Positions in J, float64 [n, 2]: the distance along both axes is the energy of the way."""
    energy_j, _ = move_costs(grid)
    scale = np.array([energy_j[0, 1] + energy_j[2, 1], energy_j[1, 0] + energy_j[1, 2]]) / 2
    return np.asarray(np.stack(np.divmod(stops, grid.columns), axis=1) * scale)


@njit(cache=True)
def _gap(places: Any, order: Any, one: Any, other: Any) -> Any:
    """Energy between the stops at two positions of the path; 0 beyond its ends."""
    if one < 0 or other >= len(order):
        return 0.0
    a, b = order[one], order[other]
    return abs(places[a, 0] - places[b, 0]) + abs(places[a, 1] - places[b, 1])


@njit(cache=True)
def _nearest(places: Any, first: Any) -> Any:
    """Always to the nearest stop that is left."""
    count = len(places)
    order = np.arange(count)
    order[0], order[first] = order[first], order[0]
    for done in range(1, count):
        best, best_gap = done, np.inf
        for candidate in range(done, count):
            gap = _gap(places, order, done - 1, candidate)
            if gap < best_gap:
                best, best_gap = candidate, gap
        order[done], order[best] = order[best], order[done]
    return order


@njit(cache=True)
def _two_opt(places: Any, order: Any) -> Any:
    """Turn round every stretch whose turning shortens the path; whether one did."""
    better = False
    for start in range(len(order) - 1):
        for end in range(start + 1, len(order)):
            now = _gap(places, order, start - 1, start) + _gap(places, order, end, end + 1)
            turned = 0.0
            if start > 0:
                turned += _gap(places, order, start - 1, end)
            if end + 1 < len(order):
                turned += _gap(places, order, start, end + 1)
            if turned < now - 1e-6:
                order[start : end + 1] = order[start : end + 1][::-1].copy()
                better = True
    return better


@njit(cache=True)
def _or_opt(places: Any, order: Any) -> Any:
    """Move every short run of stops to where it is nearer; whether one moved."""
    better = False
    for size in range(1, _LONGEST_RUN + 1):
        for start in range(len(order) - size):
            end = start + size - 1
            saved = _gap(places, order, start - 1, start) + _gap(places, order, end, end + 1)
            if start > 0 and end + 1 < len(order):
                saved -= _gap(places, order, start - 1, end + 1)
            for after in range(-1, len(order)):
                if start - 1 <= after <= end:
                    continue
                added = -_gap(places, order, after, after + 1)
                if after >= 0:
                    added += _gap(places, order, after, start)
                if after + 1 < len(order):
                    added += _gap(places, order, end, after + 1)
                if added < saved - 1e-6:
                    _move(order, start, size, after)
                    better = True
                    break
    return better


@njit(cache=True)
def _move(order: Any, start: Any, size: Any, after: Any) -> None:
    """Put a run of stops behind another position."""
    run = order[start : start + size].copy()
    if after < start:
        order[after + 1 + size : start + size] = order[after + 1 : start].copy()
        order[after + 1 : after + 1 + size] = run
    else:
        order[start : after - size + 1] = order[start + size : after + 1].copy()
        order[after - size + 1 : after + 1] = run

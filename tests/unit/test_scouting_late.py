"""A swarm that decides in flight does without the newest captures, and captures every cell once all the same."""

from __future__ import annotations

import numpy as np

from bench.scouting.campaign import known
from bench.scouting.fields import PLANTED
from bench.scouting.informed import ENERGIES, HOWS
from bench.scouting.late import Hearsay, Late, accuracies, table
from bench.scouting.ours import Ours
from fleet.functions.belief import Belief
from fleet.planning.tactics import Tactics

AGENTS = 3


def test_the_newest_captures_are_captured_but_not_known() -> None:
    place = known(PLANTED, 0)
    heard, before = Hearsay(place.grid, lag=2), Belief(place.grid)
    cells = [40, 300, 77, 1200, 5]
    for cell in cells:
        heard.hear(cell, float(place.truth[cell]))
    before.observe(cells[:3], place.truth[cells[:3]])
    assert heard.captured == 3
    assert np.array_equal(heard.prediction().values, before.prediction().values)
    assert not heard.free.flat[cells].any()
    assert np.count_nonzero(before.free) - np.count_nonzero(heard.free) == 2


def test_without_a_lag_the_swarm_flies_as_ever() -> None:
    place = known(PLANTED, 0)
    at_once = Ours().fly(place, AGENTS, 0, None)
    for late, flight in zip(Late(place, AGENTS, 0, Tactics(), lag=0).scout(), at_once, strict=True):
        assert np.array_equal(late.cells, flight.cells)


def test_with_a_lag_it_flies_otherwise_and_captures_every_cell() -> None:
    place = known(PLANTED, 0)
    flights = Late(place, AGENTS, 0, Tactics(), lag=AGENTS).scout()
    captured = np.concatenate([flight.cells[flight.captured] for flight in flights])
    assert np.unique(captured).tolist() == place.cells.tolist()
    assert not np.array_equal(flights[0].cells, Ours().fly(place, AGENTS, 0, None)[0].cells)


def test_accuracy_is_compared_with_that_of_the_planned_swarm() -> None:
    found = accuracies((PLANTED, AGENTS, 0, 3))
    assert found.shape == (2, len(HOWS), len(ENERGIES))
    assert not np.array_equal(found[0], found[1])
    better = found.copy()
    better[0] += 0.01
    shown = table(["a", "b"], np.stack([[better] * 2, [found] * 2]))
    gap = 100 * (found[0] - found[1]).mean(axis=-1)
    assert [row.split()[0] for row in shown.columns[1]._cells] == [f"{each + 0.5:+.1f}" for each in gap]  # type: ignore[union-attr]  # cells are texts

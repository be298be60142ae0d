"""The compiled simulator does exactly what the plain reference does."""

from __future__ import annotations

import hashlib
from dataclasses import fields

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fleet.contexts.grid import Grid
from fleet.energy.accounting import EnergyModel
from fleet.energy.profiles import load_aircraft, load_edge
from fleet.missions.layout import MOVES, Layout, plan_layout
from fleet.simulator import reference
from fleet.simulator.batch import Batch, Finished, Flown, Trace, fly
from fleet.spec.swarm import Action, AgentSpec, GroupOrder, Groups, Start, StateSpace

SEED = st.integers(0, 2**32 - 1)


@st.composite
def layouts(draw: st.DrawFn) -> Layout:
    rows, columns = draw(st.integers(1, 12)), draw(st.integers(1, 12))
    generator = np.random.default_rng(draw(SEED))
    valid = generator.random((rows, columns)) < draw(st.sampled_from([0.3, 0.7, 0.95, 1.0]))
    valid[generator.integers(rows), generator.integers(columns)] = True
    grid = Grid(valid, rows_go_south=draw(st.booleans()), columns_go_east=draw(st.booleans()))
    groups = Groups(
        rows=draw(st.integers(1, 12)), columns=draw(st.integers(1, 12)), order=draw(st.sampled_from(GroupOrder))
    )
    space = StateSpace(context="field", groups=groups, capture_in_transit=draw(st.booleans()))
    blocks = {(row // groups.rows, column // groups.columns) for row, column in zip(*np.nonzero(valid), strict=True)}
    agents = [draw(agent(f"agent-{i}", rows, columns)) for i in range(draw(st.integers(1, min(6, len(blocks)))))]
    return plan_layout(grid, space, agents)


@st.composite
def agent(draw: st.DrawFn, name: str, rows: int, columns: int) -> AgentSpec:
    actions = draw(st.lists(st.sampled_from(Action), min_size=1, max_size=8))
    start = draw(st.none() | st.builds(Start, row=st.integers(0, rows - 1), column=st.integers(0, columns - 1)))
    return AgentSpec(name=name, actions=tuple(actions), start=start)


@st.composite
def batches(draw: st.DrawFn, layout: Layout) -> Batch:
    missions, tables, rewards = draw(st.integers(1, 4)), draw(st.integers(1, 3)), draw(st.integers(1, 2))
    generator = np.random.default_rng(draw(SEED))
    blank = layout.group_of < 0
    scores = generator.normal(size=(tables, layout.grid.cells, len(MOVES)))
    if draw(st.booleans()):
        scores = np.round(scores)  # many equal ones
    scores[:, blank] = np.nan
    reward = generator.random((rewards, layout.grid.cells)) - draw(st.sampled_from([0.0, 0.3]))
    if draw(st.booleans()):
        reward = np.round(reward * 2) / 2  # sums that are equal to thresholds
    reward[:, blank] = np.nan
    return Batch(
        scores=scores,
        table=generator.integers(tables, size=(missions, layout.agents)),
        rewards=reward,
        reward_of=generator.integers(rewards, size=missions),
        utility_thresholds=generator.choice([0.0, 0.4, 1.5, 4.0, np.inf], size=missions),
        visited_thresholds=generator.choice([0, 1, 3, 7, 2**62], size=missions),
        exploration=generator.choice([0.0, 0.2, 1.0], size=missions),
        missions=generator.integers(0, 2**40, size=missions),
        seed=draw(st.integers(-(2**70), 2**70)),
    )


@st.composite
def cases(draw: st.DrawFn) -> tuple[Layout, Batch]:
    layout = draw(layouts())
    return layout, draw(batches(layout))


def assert_same(left: Flown | Trace, right: Flown | Trace) -> None:
    for field in fields(left):
        one, other = getattr(left, field.name), getattr(right, field.name)
        if isinstance(one, Trace):
            assert_same(one, other)
        elif one is not None:
            assert one.dtype == other.dtype, field.name
            np.testing.assert_array_equal(one, other, err_msg=field.name)
        else:
            assert other is None, field.name


@settings(max_examples=200)
@given(cases())
def test_same_seed_gives_the_same_trace_as_the_reference(case: tuple[Layout, Batch]) -> None:
    layout, batch = case
    assert_same(fly(layout, batch, traced=True), reference.fly(layout, batch, traced=True))


@settings(max_examples=60)
@given(cases(), st.integers(1, 5))
def test_eval_in_flight_is_asked_the_same_and_lands_the_same(case: tuple[Layout, Batch], rarely: int) -> None:
    layout, batch = case
    asked: list[list[tuple[int, int, bytes]]] = [[], []]

    def finished_of(log: list[tuple[int, int, bytes]]) -> Finished:
        def finished(mission: int, agent: int, captured: NDArray[np.bool_]) -> bool:
            log.append((mission, agent, captured.tobytes()))
            return hashlib.blake2b(captured.tobytes()).digest()[0] % rarely == 0

        return finished

    compiled, plain = (
        form(layout, batch, True, finished_of(log)) for form, log in zip((fly, reference.fly), asked, strict=True)
    )
    assert_same(compiled, plain)
    assert asked[0] == asked[1]


@settings(max_examples=40)
@given(cases())
def test_a_trace_changes_nothing(case: tuple[Layout, Batch]) -> None:
    layout, batch = case
    plain, traced = fly(layout, batch), fly(layout, batch, traced=True)
    assert plain.trace is None
    for field in fields(plain):
        if field.name != "trace":
            np.testing.assert_array_equal(getattr(plain, field.name), getattr(traced, field.name))


@settings(max_examples=100)
@given(cases())
def test_every_group_is_explored_and_no_cell_is_captured_twice(case: tuple[Layout, Batch]) -> None:
    layout, batch = case
    flown = fly(layout, batch, traced=True)
    assert flown.trace is not None
    assert (flown.groups_explored == [last - first for first, last in layout.parts]).all()
    for mission, agent in np.ndindex(flown.steps.shape):
        steps = int(flown.steps[mission, agent])
        cells, captured = flown.trace.cell[mission, agent], flown.trace.captured[mission, agent]
        seen = cells[captured]
        assert len(np.unique(seen)) == len(seen) == flown.captures[mission, agent]
        assert (layout.group_of[seen] >= 0).all()
        assert (cells[:steps] >= 0).all()
        assert (cells[steps:] == -1).all()
        assert_groups_are_done(layout, batch, mission, agent, cells[:steps], captured[:steps])


def assert_groups_are_done(
    layout: Layout, batch: Batch, mission: int, agent: int, cells: NDArray[np.int32], captured: NDArray[np.bool_]
) -> None:
    rewards = batch.rewards[batch.reward_of[mission]]
    for group in range(*layout.parts[agent]):
        mine = captured & (layout.group_of[cells] == group)
        utility, most = 0.0, 0.0
        for step in np.flatnonzero(mine):
            utility += rewards[cells[step]] if step > 0 else 0.0
            most = max(most, utility)  # what is captured in transit after the group is done may take some away again
        assert (
            mine.sum() == len(layout.groups[group])
            or mine.sum() > batch.visited_thresholds[mission]
            or most > batch.utility_thresholds[mission]
        )


@settings(max_examples=40)
@given(cases())
def test_energy_is_the_sum_over_the_trace(case: tuple[Layout, Batch]) -> None:
    layout, batch = case
    energy = EnergyModel(load_aircraft("spark-survey"), load_edge("laptop-i5"), hovering=True)
    flown = fly(layout, batch, traced=True)
    assert flown.trace is not None
    for mission, agent in np.ndindex(flown.steps.shape):
        total = energy.take_off() + energy.land()
        for step in range(int(flown.steps[mission, agent])):
            move = int(flown.trace.move[mission, agent, step])
            total += energy.capture() * int(flown.trace.captured[mission, agent, step])
            total += energy.decision() * int(flown.trace.legal[mission, agent, step] != 0)
            if move >= 0:
                total += energy.move(MOVES[move])
        counted = energy.flight(flown.counts(mission, agent))
        np.testing.assert_allclose([counted.time_s, counted.energy_j], [total.time_s, total.energy_j], rtol=1e-9)

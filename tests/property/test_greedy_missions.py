"""Compiled missions with belief features in the SSV against plain ones over a belief of the whole field."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pettingzoo.test import parallel_api_test

from bench.greedy.meadow import FEATURES, Meadow
from bench.greedy.peers import BeliefEnv, World, plain_fly, step_through
from fleet.contexts.base import Environment
from fleet.contexts.grid import Grid
from fleet.errors import ContextError
from tests.planning import ENERGY, Values, drawn, environment


@st.composite
def fields(draw: st.DrawFn) -> tuple[Environment, list[int]]:
    """Small fields with holes, and where agents take off: neighbours of a cell are never out of sight."""
    rows, columns = draw(st.integers(1, 14)), draw(st.integers(2, 14))
    seed = draw(st.integers(0, 2**16))
    truth = drawn(seed, rows, columns) * draw(st.sampled_from([1.0, -1.0]))
    generator = np.random.default_rng(seed)
    truth[generator.random(truth.shape) < draw(st.sampled_from([0.0, 0.2, 0.5]))] = np.nan
    truth[0, :2] = 100.0, 120.0
    height, width = draw(st.sampled_from([(1.0, 1.0), (11.9, 8.9)]))
    around = draw(st.booleans()), draw(st.booleans())
    cells = np.flatnonzero(np.isfinite(truth))
    starts = generator.choice(cells, min(draw(st.integers(1, 4)), len(cells)), replace=False)
    return Environment("field", "", Grid(np.isfinite(truth), height, width, *around), "exg", truth), starts.tolist()


@settings(max_examples=80)
@given(fields(), st.integers(0, 2**16), st.integers(1, 60))
def test_the_compiled_missions_are_the_plain_ones(field: tuple[Environment, list[int]], seed: int, moves: int) -> None:
    place, starts = field
    weights = np.random.default_rng(seed).normal(size=(3, len(FEATURES)))
    paths = Meadow.of(place, ENERGY).fly(starts, weights, moves)
    for row, path in zip(weights, paths, strict=True):
        plain = plain_fly(World(place, ENERGY, starts), row.tolist(), moves)
        assert [cells[cells >= 0].tolist() for cells in path] == plain


def test_a_field_is_captured_whole_when_there_is_time() -> None:
    truth: Values = drawn(2, 13, 15)
    truth[4:9, 5:9] = np.nan
    path = Meadow.of(environment(truth), ENERGY).fly([0, 100], np.ones((1, len(FEATURES))), 400)[0]
    assert set(np.flatnonzero(np.isfinite(truth)).tolist()) <= set(path[path >= 0].tolist())
    assert (path[:, -1] == -1).all()


def test_a_field_of_which_nothing_is_known_cannot_be_flown_over() -> None:
    with pytest.raises(ContextError, match="nothing is known of the truth in elsewhere"):
        Meadow.of(Environment("elsewhere", "", Grid(np.ones((3, 3), dtype=np.bool_))), ENERGY)


def test_the_environment_keeps_to_the_parallel_api() -> None:
    parallel_api_test(BeliefEnv(environment(drawn(0, 6, 7)), ENERGY, [0, 30]), num_cycles=60)


def test_one_agent_flies_through_the_parallel_api_as_it_does_alone() -> None:
    place, weights = environment(drawn(3, 9, 10)), np.array([1.0, 0.3, 0.2, 0.1, -0.3])
    env = BeliefEnv(place, ENERGY, [44])
    assert step_through(env, weights, 70) == 71
    plain = plain_fly(World(place, ENERGY, [44]), weights.tolist(), 70)[0]
    assert env._world.at == plain[-1:]
    assert env._world.belief.captured == len(set(plain))

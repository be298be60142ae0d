"""The PettingZoo adapter passes PettingZoo's own tests, and flies as the reference does."""

from __future__ import annotations

import importlib
import sys

import numpy as np
import pytest
from numpy.typing import NDArray
from pettingzoo.test import parallel_api_test, parallel_seed_test, seed_test
from pettingzoo.utils.conversions import parallel_to_aec

from fleet.contexts.grid import Grid
from fleet.errors import MissionError, TrainingError
from fleet.missions.history import ThresholdHA
from fleet.missions.layout import MOVES, Layout, plan_layout
from fleet.simulator import parallel_env, reference
from fleet.simulator.batch import Batch
from fleet.simulator.parallel_env import MissionEnv
from fleet.spec.swarm import CARDINAL, AgentSpec, Groups, Start, StateSpace


def layout_of(agents: int = 3) -> Layout:
    valid = np.random.default_rng(3).random((9, 8)) < 0.85
    space = StateSpace(context="field", groups=Groups(rows=3, columns=2))
    specs = [AgentSpec(name=f"a{i}", actions=CARDINAL, start=Start(row=8, column=i)) for i in range(agents)]
    return plan_layout(Grid(valid), space, specs)


def env_of(visited_threshold: int = 5) -> MissionEnv:
    generator = np.random.default_rng(4)
    layout = layout_of()
    return MissionEnv(layout, generator.random((72, 4)), generator.random(72), ThresholdHA(2.5, visited_threshold))


def test_passes_the_api_test() -> None:
    parallel_api_test(env_of(), num_cycles=200)


def test_passes_the_api_test_when_agents_land_without_a_choice() -> None:
    parallel_api_test(env_of(visited_threshold=0), num_cycles=50)


def test_passes_the_seed_tests() -> None:
    parallel_seed_test(env_of)
    seed_test(lambda: parallel_to_aec(env_of()), num_cycles=200)


def test_observations_are_in_their_space_and_masks_tell_the_legal_moves() -> None:
    env = env_of()
    observed, _ = env.reset()
    while env.agents:
        for agent in env.agents:
            assert env.observation_space(agent).contains(observed[agent])
            assert observed[agent]["action_mask"].any()
        observed, *_ = env.step({agent: int(observed[agent]["action_mask"].argmax()) for agent in env.agents})


def test_following_a_score_table_visits_what_the_reference_visits() -> None:
    layout = layout_of()
    generator = np.random.default_rng(4)
    observations, rewards = generator.random((72, 4)), generator.random(72)
    scores = generator.random((72, len(MOVES)))
    env = MissionEnv(layout, observations.astype(np.float32), rewards, ThresholdHA(2.5, 5))
    observed, infos = env.reset()
    states = {agent: infos[agent]["states"] for agent in env.agents}
    gained = dict.fromkeys(env.agents, 0.0)
    cell_of = {tuple(row): cell for cell, row in enumerate(observations.astype(np.float32).tolist())}
    while env.agents:
        actions = {}
        for agent in env.agents:
            row = scores[cell_of[tuple(observed[agent]["observation"].tolist())]]
            actions[agent] = int(np.where(observed[agent]["action_mask"], row, -np.inf).argmax())
        observed, reward, _, _, infos = env.step(actions)
        for agent in reward:
            states[agent] += infos[agent]["states"]
            gained[agent] += reward[agent]
    flown = reference.fly(layout, batch_of(layout, scores, rewards), traced=True)
    assert flown.trace is not None
    assert flown.decisions.min() > 5
    assert list(states.values()) == flown.steps[0].tolist()
    chosen = flown.trace.legal[0, :, :-1] != 0
    expected = np.where(chosen, rewards[flown.trace.cell[0, :, 1:]], 0.0).sum(axis=1)
    np.testing.assert_allclose(list(gained.values()), expected)


def batch_of(layout: Layout, scores: NDArray[np.float64], rewards: NDArray[np.float64]) -> Batch:
    return Batch(
        scores=scores[None],
        table=np.zeros((1, layout.agents), dtype=np.int64),
        rewards=rewards[None],
        reward_of=np.zeros(1, dtype=np.int64),
        utility_thresholds=np.array([2.5]),
        visited_thresholds=np.array([5]),
        exploration=np.zeros(1),
        missions=np.zeros(1, dtype=np.int64),
    )


def test_an_illegal_action_is_replaced_by_the_first_legal_one_and_reported() -> None:
    env = env_of()
    observed, _ = env.reset()
    illegal = {agent: int(observed[agent]["action_mask"].argmin()) for agent in env.agents}
    *_, infos = env.step(illegal)
    assert {agent: info["replaced"] for agent, info in infos.items()} == dict.fromkeys(illegal, True)


def test_arrays_that_do_not_fit_the_layout_are_refused() -> None:
    with pytest.raises(MissionError, match="72 cells and 3 agents; there are 71 observations"):
        MissionEnv(layout_of(), np.zeros((71, 4)), np.zeros(72), ThresholdHA(1.0, 1))


def test_without_the_extra_the_error_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pettingzoo", None)
    with pytest.raises(TrainingError, match=r"fleet-computer\[marl\]"):
        importlib.reload(parallel_env)

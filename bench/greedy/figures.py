"""Agent-steps a second of the missions of this folder."""

from __future__ import annotations

import numpy as np

from bench.belief import corn, made_up
from bench.greedy.meadow import FEATURES, Meadow
from bench.greedy.peers import BeliefEnv, World, plain_fly, step_through
from bench.measure import Result, seconds
from bench.scouting.flight import ENERGY
from fleet.missions.partition import parts

AGENTS, MISSIONS = 4, 256


def with_belief(share: float, command: str) -> list[Result]:
    """Missions to about a share of the field, each with weights of its own; next to both peers."""
    environment = corn() or made_up(2_106)
    starts = [int(part[len(part) // 2]) for part in parts(environment.grid, AGENTS)]
    meadow = Meadow.of(environment, ENERGY)
    weights = np.random.default_rng(0).uniform(0.0, 1.0, (MISSIONS, len(FEATURES)))
    moves = round(share * meadow.ground.size / AGENTS)
    one = weights[0].tolist()

    steps = int(np.count_nonzero(meadow.fly(starts, weights, moves) >= 0))
    figure = steps / seconds(lambda: meadow.fly(starts, weights, moves), repeats=20)
    visited = sum(len(path) for path in plain_fly(World(environment, ENERGY, starts), one, moves))
    plain = visited / seconds(lambda: plain_fly(World(environment, ENERGY, starts), one, moves), repeats=3)
    env = BeliefEnv(environment, ENERGY, starts)
    visited = step_through(env, weights[0], moves)
    stepped = visited / seconds(lambda: step_through(env, weights[0], moves), repeats=3)
    name = f"simulator, belief features in the SSV, {MISSIONS} missions to {share:.0%} ({environment.name}, 4 agents)"
    peers = (("plain loop over Belief", plain), ("PettingZoo stepping", stepped))
    return [Result.against(name, figure, "agent-steps/s", peer, command) for peer in peers]

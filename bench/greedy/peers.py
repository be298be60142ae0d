"""The missions of `bench.greedy.meadow` in plain Python over `Belief`, and through PettingZoo's parallel API."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from bench.greedy.meadow import FEATURES, STRAIGHT
from fleet.contexts.base import Environment
from fleet.energy.accounting import EnergyModel
from fleet.functions.belief import Belief
from fleet.functions.classes import CLASS_THRESHOLDS
from fleet.functions.kriging import fit
from fleet.missions.layout import MOVES

Values = NDArray[np.float64]


class World:
    """A field, what is believed of it, and where the agents are.

    Args:
        environment: The field; its truth is known.
        energy: What moves cost.
        starts: Where agents take off.
    """

    def __init__(self, environment: Environment, energy: EnergyModel, starts: Sequence[int]) -> None:
        assert environment.truth is not None
        self.grid, self._truth = environment.grid, environment.truth
        variogram = fit(np.where(self.grid.valid, self._truth, np.nan), self.grid.valid, self.grid)
        self.belief = Belief(self.grid, variogram)
        self._sill = math.sqrt(variogram.variance)
        costs = [energy.move(move).energy_j for move in MOVES[:STRAIGHT]]
        self._costs = [cost * STRAIGHT / sum(costs) for cost in costs]
        self.at, self._last = list(starts), [-1] * len(starts)
        self._target = [-1] * len(starts)
        self._total = 0.0
        for agent in range(len(starts)):
            self._capture(agent)

    @property
    def is_over(self) -> bool:
        return self.belief.captured == self.belief.cells

    def ssvs(self, agent: int) -> dict[int, tuple[float, ...]]:
        """Features of the states that moves of an agent lead to, of those that can be captured."""
        return {
            move: self._ssv(agent, move, cell)
            for move, cell in enumerate(self._beside(self.at[agent]))
            if cell is not None and self.belief.free.flat[cell]
        }

    def move(self, agent: int, move: int) -> None:
        """Make a move, and capture what it leads to."""
        cell = self.grid.neighbour(self.at[agent], MOVES[move])
        assert cell is not None
        self.at[agent], self._last[agent] = cell, move
        self._capture(agent)

    def on_the_way(self, agent: int) -> int:
        """The move towards the nearest free cell, which an agent keeps to as long as it is free."""
        row, column = self.grid.position(self.at[agent])
        if self._target[agent] < 0 or not self.belief.free.flat[self._target[agent]]:
            down, across = (axis - here for axis, here in zip(np.nonzero(self.belief.free), (row, column), strict=True))
            ratio = self.grid.cell_height_m / self.grid.cell_width_m
            nearest = int(np.argmin(down * down * (ratio * ratio) + across * across))
            self._target[agent] = self.grid.cell(row + int(down[nearest]), column + int(across[nearest]))
        to_row, to_column = self.grid.position(self._target[agent])
        step: tuple[int, int] = (0, int(np.sign(to_column - column)))
        if abs(to_row - row) >= abs(to_column - column):
            step = (int(np.sign(to_row - row)), 0)
        return next(move for move in range(STRAIGHT) if self.grid.step(MOVES[move]) == step)

    def _beside(self, cell: int) -> list[int | None]:
        return [self.grid.neighbour(cell, move) for move in MOVES[:STRAIGHT]]

    def _ssv(self, agent: int, move: int, cell: int) -> tuple[float, ...]:
        mean, deviation = float(self.belief.state.mean[cell]), float(self.belief.state.deviation[cell])
        free = sum(bool(self.belief.free.flat[beside]) for beside in self._beside(cell) if beside is not None)
        ahead = 1.0 if move == self._last[agent] else 0.0
        return self._doubt(mean, deviation), deviation / self._sill, free / 4.0, ahead, self._costs[move]

    def _doubt(self, mean: float, deviation: float) -> float:
        of = self._total / self.belief.captured
        bounds = sorted(threshold * of for threshold in CLASS_THRESHOLDS)
        below = [0.5 * (1.0 + math.erf((bound - mean) / (deviation * math.sqrt(2.0)))) for bound in bounds]
        return 1.0 - max(more - less for less, more in zip([0.0, *below], [*below, 1.0], strict=True))

    def _capture(self, agent: int) -> None:
        cell = self.at[agent]
        if self.belief.free.flat[cell]:
            self._total += float(self._truth.flat[cell])
            self.belief.observe([cell], [self._truth.flat[cell]])


def plain_fly(world: World, weights: Sequence[float], moves: int) -> list[list[int]]:
    """As `Meadow.fly`: the cells of each agent in the order of flight."""
    paths = [[cell] for cell in world.at]
    for _ in range(moves):
        for agent, path in enumerate(paths):
            if not world.is_over:
                ssvs = world.ssvs(agent)
                world.move(agent, best_of(ssvs, weights) if ssvs else world.on_the_way(agent))
                path.append(world.at[agent])
    return paths


def best_of(ssvs: Mapping[int, Sequence[float]], weights: Sequence[float]) -> int:
    """The move whose weighted features are most, the first of equals."""
    scores = {move: sum(w * x for w, x in zip(weights, ssv, strict=True)) for move, ssv in ssvs.items()}
    return max(scores, key=lambda move: (scores[move], -move))


class BeliefEnv(ParallelEnv[str, dict[str, NDArray[Any]], int]):  # type: ignore[misc] # pettingzoo ships no types
    """The same as a `ParallelEnv`: agents choose at once, and then move one after the other.

    An observation has the features of each move, float64 [4, 5], zeros for moves that the mask does not allow. An agent
    without a legal move flies on by itself. The reward is the doubt about the cell that is captured.
    """

    metadata: Mapping[str, Any] = {"name": "fleet_belief_v0", "render_modes": []}
    render_mode = None

    def __init__(self, environment: Environment, energy: EnergyModel, starts: Sequence[int]) -> None:
        self._made_of = (environment, energy, starts)
        self.possible_agents = [f"agent-{number + 1}" for number in range(len(starts))]
        self.agents: list[str] = []
        self._world = World(*self._made_of)
        self._space = spaces.Dict(
            {
                "observation": spaces.Box(-np.inf, np.inf, (STRAIGHT, len(FEATURES)), np.float64),
                "action_mask": spaces.MultiBinary(STRAIGHT),
            }
        )
        self._actions = spaces.Discrete(STRAIGHT)

    def observation_space(self, agent: str) -> Any:
        return self._space

    def action_space(self, agent: str) -> Any:
        return self._actions

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> tuple[Any, Any]:
        del seed, options
        self._world, self.agents = World(*self._made_of), list(self.possible_agents)
        return self._observed(), {agent: {} for agent in self.agents}

    def step(self, actions: Mapping[str, int]) -> tuple[Any, Any, Any, Any, Any]:
        flying, rewards = self.agents, dict.fromkeys(self.agents, 0.0)
        for number, agent in enumerate(flying):
            if not self._world.is_over:
                ssvs = self._world.ssvs(number)
                action = int(actions[agent])
                move = action if action in ssvs else next(iter(ssvs), self._world.on_the_way(number))
                rewards[agent] = ssvs[move][0] if move in ssvs else 0.0
                self._world.move(number, move)
        over = dict.fromkeys(flying, self._world.is_over)
        observed = self._observed()
        self.agents = [] if self._world.is_over else flying
        return observed, rewards, over, dict.fromkeys(flying, False), {agent: {} for agent in flying}

    def _observed(self) -> dict[str, dict[str, NDArray[Any]]]:
        observed = {}
        for number, agent in enumerate(self.agents):
            features, mask = np.zeros((STRAIGHT, len(FEATURES))), np.zeros(STRAIGHT, dtype=np.int8)
            for move, ssv in self._world.ssvs(number).items():
                features[move], mask[move] = ssv, 1
            observed[agent] = {"observation": features, "action_mask": mask}
        return observed


def step_through(env: BeliefEnv, weights: Values, moves: int) -> int:
    """Fly a mission; how many states were visited."""
    observed, _ = env.reset()
    states = len(env.agents)
    for _ in range(moves):
        if env.agents:
            states += len(env.agents)
            actions = {
                agent: int(np.where(seen["action_mask"], seen["observation"] @ weights, -np.inf).argmax())
                for agent, seen in observed.items()
            }
            observed, *_ = env.step(actions)
    return states

"""Missions as a PettingZoo `ParallelEnv`, for learners that come with that interface (extra `marl`).

One step of the environment is one choice of SA of every agent that still flies. What the layout and HA do between two
choices (leaving a group, travelling to the next state that is left) happens within the step: there is nothing to choose
there, and a step with a single legal action would teach a learner nothing. So agents that are in the same step of the
environment may have visited different numbers of states; they do not touch each other, so this changes no flight.

An agent terminates when it lands. One that SA is never asked for lands in the first step, whatever its action.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fleet.errors import MissionError, TrainingError
from fleet.missions.flight import LAND, Arrival, Flight, HistoryToAction
from fleet.missions.layout import MOVES, Layout

try:
    from gymnasium import spaces
    from pettingzoo import ParallelEnv
except ImportError as error:
    raise TrainingError(
        "the ParallelEnv adapter needs gymnasium and pettingzoo; install the extra: pip install 'fleet-computer[marl]'"
    ) from error

Observation = dict[str, NDArray[Any]]
"""`observation`: the normalised SSV, float32 [features]; `action_mask`: legal moves, int8 [len(MOVES)]."""


class MissionEnv(ParallelEnv[str, Observation, int]):  # type: ignore[misc] # pettingzoo ships no types
    """One mission after the other over the same layout.

    An action is an index into MOVES. One that the mask does not allow is replaced by the first that it does. The reward
    is R of the state that the move leads to. Each agent's info has `states`, how many it has visited since its last
    choice, `cell`, where it is, and `replaced`, whether its action was. Nothing is random, so seeds change nothing.

    Args:
        layout: Who flies where.
        observations: Normalised SSV of each cell, in [0, 1], [cells, features]; rows without data are never read.
        rewards: R of a transition into each cell, [cells]; likewise.
        ha: When to leave a group.
        agents: Names of the agents, in the layout's order; `agent-1`, `agent-2`, ... when left out.

    Raises:
        MissionError: the arrays or names do not fit the layout.
    """

    metadata: Mapping[str, Any] = {"name": "fleet_mission_v0", "render_modes": []}
    render_mode = None

    def __init__(
        self,
        layout: Layout,
        observations: NDArray[np.float64],
        rewards: NDArray[np.float64],
        ha: HistoryToAction,
        agents: Sequence[str] = (),
    ) -> None:
        self.possible_agents = list(agents) or [f"agent-{i + 1}" for i in range(layout.agents)]
        self.agents: list[str] = []
        cells = layout.grid.cells
        if len(observations) != cells or rewards.shape != (cells,) or len(self.possible_agents) != layout.agents:
            raise MissionError(
                f"the layout has {cells} cells and {layout.agents} agents; there are {len(observations)} observations, "
                f"{len(rewards)} rewards and {len(self.possible_agents)} names"
            )
        self._layout, self._ha = layout, ha
        self._observations = observations.astype(np.float32)
        self._rewards = rewards
        self._flights: dict[str, Flight] = {}
        self._arrivals: dict[str, Arrival] = {}
        self._observation_spaces = {agent: self._observation_space() for agent in self.possible_agents}
        self._action_spaces = {agent: spaces.Discrete(len(MOVES)) for agent in self.possible_agents}

    def observation_space(self, agent: str) -> Any:
        """The same object at every call."""
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """The same object at every call."""
        return self._action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Start a mission; every agent flies until SA is asked. Neither argument changes anything."""
        del seed, options
        self.agents = list(self.possible_agents)
        self._flights = {name: Flight(self._layout, index, self._ha) for index, name in enumerate(self.agents)}
        states = {name: self._fly_on(name) for name in self.agents}
        infos = {name: self._info(name, states[name]) for name in self.agents}
        return {name: self._observe(name) for name in self.agents}, infos

    def step(
        self, actions: Mapping[str, int]
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Make one move of every agent that still flies, and fly on until SA is asked again."""
        flying, rewards, infos = self.agents, {}, {}
        for name in flying:
            rewards[name], infos[name] = self._move(name, int(actions[name]))
        terminated = {name: self._flights[name].landed for name in flying}
        self.agents = [name for name in flying if not terminated[name]]
        observed = {name: self._observe(name) for name in flying}
        return observed, rewards, terminated, dict.fromkeys(flying, False), infos

    def _move(self, name: str, action: int) -> tuple[float, dict[str, Any]]:
        flight, arrival = self._flights[name], self._arrivals[name]
        if flight.landed:
            return 0.0, self._info(name, 0)
        allowed = bool(arrival.legal >> action & 1)
        flight.leave(arrival, action if allowed else (arrival.legal & -arrival.legal).bit_length() - 1)
        reward = float(self._rewards[flight.cell])
        return reward, self._info(name, self._fly_on(name), replaced=not allowed)

    def _info(self, name: str, states: int, replaced: bool = False) -> dict[str, Any]:
        return {"states": states, "cell": self._flights[name].cell, "replaced": replaced}

    def _fly_on(self, name: str) -> int:
        """Do what needs no choice, until there is one or the agent has landed; the number of visited states."""
        flight, states = self._flights[name], 0
        while not flight.landed:
            arrival = self._arrivals[name] = flight.arrive(float(self._rewards[flight.cell]))
            states += 1
            if arrival.legal:
                break
            flight.leave(arrival, LAND)
        return states

    def _observe(self, name: str) -> Observation:
        legal = 0 if self._flights[name].landed else self._arrivals[name].legal
        mask = np.array([legal >> move & 1 for move in range(len(MOVES))], dtype=np.int8)
        return {"observation": self._observations[self._flights[name].cell], "action_mask": mask}

    def _observation_space(self) -> Any:
        return spaces.Dict(
            {
                "observation": spaces.Box(0.0, 1.0, self._observations.shape[1:], np.float32),
                "action_mask": spaces.MultiBinary(len(MOVES)),
            }
        )

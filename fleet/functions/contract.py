"""The two functions that a user writes, and what they take and give.

Map(D) -> SSV                             paper, section "Map() and Eval() Functions"
Eval(FS, metrics) -> finished, P, artefacts
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Environment, Observation

SSV = dict[str, float]
"""A state-space vector: features by name, in order."""

Extractor = Callable[[Observation], SSV]
"""A part of Map(): some features from an observation."""

MapFunction = Callable[[Observation], SSV]
"""Map() as the user writes it."""


@dataclass(frozen=True, eq=False)
class FeatureSpace:
    """FS of the paper: the SSVs of all states that were captured, sorted by state, each state once.

    Args:
        features: Names of the features, in the order of the SSV's columns.
        states: Cell numbers, int64 [n].
        ssv: Feature values, float64 [n, len(features)].
        environment: The place that was flown over; has the truth in replay only.
    """

    features: tuple[str, ...]
    states: NDArray[np.int64]
    ssv: NDArray[np.float64]
    environment: Environment

    def __len__(self) -> int:
        return len(self.states)

    def feature(self, name: str) -> NDArray[np.float64]:
        """Values of one feature, [n]. Raises KeyError when Map() gives no such feature."""
        if name not in self.features:
            raise KeyError(f"Map() gives no feature {name!r}; it gives {', '.join(self.features)}")
        return self.ssv[:, self.features.index(name)]

    def grid_of(self, name: str) -> NDArray[np.float64]:
        """One feature on the grid, [rows, columns], NaN where nothing was captured."""
        grid = self.environment.grid
        values = np.full(grid.cells, np.nan)
        values[self.states] = self.feature(name)
        return values.reshape(grid.rows, grid.columns)


@dataclass(frozen=True)
class AgentMetrics:
    """What one agent spent.

    Args:
        steps: States visited, captured or not, the take-off cell included.
        captures: States captured.
        time_s: Flight time, take-off and landing included.
        uav_energy_j: Energy of the aircraft.
        edge_energy_j: Energy of the edge machine that serves the agent.
        groups: State groups that are the agent's.
        groups_explored: State groups that HA has left, or that have nothing more to visit.
    """

    agent: str
    steps: int = 0
    captures: int = 0
    time_s: float = 0.0
    uav_energy_j: float = 0.0
    edge_energy_j: float = 0.0
    groups: int = 0
    groups_explored: int = 0


@dataclass(frozen=True)
class Metrics:
    """System-level metrics of a mission: m of Eval(FS, m)."""

    agents: tuple[AgentMetrics, ...]

    @property
    def time_s(self) -> float:
        """Time of the mission: that of the slowest agent."""
        return max((agent.time_s for agent in self.agents), default=0.0)

    @property
    def uav_energy_j(self) -> float:
        """Energy of all aircraft."""
        return sum(agent.uav_energy_j for agent in self.agents)

    @property
    def edge_energy_j(self) -> float:
        """Energy of all edge machines."""
        return sum(agent.edge_energy_j for agent in self.agents)

    @property
    def explored(self) -> bool:
        """Whether every agent has explored all of its state groups."""
        return all(agent.groups_explored >= agent.groups for agent in self.agents)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What Eval() says of a mission.

    Args:
        finished: Whether the agents need not go on.
        metrics: P of the paper: numbers by name; goals speak of these.
        artefacts: Results for the user: grids [rows, columns] by name, such as `predicted` and `class`.
    """

    finished: bool
    metrics: Mapping[str, float]
    artefacts: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)


EvalFunction = Callable[[FeatureSpace, Metrics], Evaluation]
"""Eval() as the user writes it."""


class MapClient(Protocol):
    """Map(), wherever it runs; every answer is checked."""

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the SSV's features, in order."""

    @property
    def version(self) -> str:
        """Changes when Map() may give another SSV for the same observation."""

    def map(self, observation: Observation, agent: str = "") -> NDArray[np.float64]:
        """SSV of an observation, float64 [len(features)], finite.

        Raises:
            FunctionError: after the retries; names the agent, the state and the extractor.
        """


class EvalClient(Protocol):
    """Eval(), wherever it runs; every answer is checked."""

    @property
    def version(self) -> str:
        """Changes when Eval() may say something else of the same mission."""

    def evaluate(self, fs: FeatureSpace, metrics: Metrics, agent: str = "") -> Evaluation:
        """Evaluate a mission, or one agent's part of it.

        Raises:
            FunctionError: after the retries.
        """

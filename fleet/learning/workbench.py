"""What shaping, training and simulation work on: the contexts of a FleetSpec, mapped and laid out for its agents."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from fleet.contexts.grid import Grid
from fleet.contexts.load import load_context
from fleet.energy.accounting import EnergyModel
from fleet.energy.model import energy_model
from fleet.functions.contract import EvalClient, MapClient
from fleet.learning.practice import Grounds
from fleet.missions.layout import layout_of
from fleet.simulator.terrain import Terrain, survey
from fleet.spec.functions import ContextUse
from fleet.spec.resources import Fleet
from fleet.spec.swarm import AgentSpec
from fleet.storage.layout import FleetPaths
from fleet.storage.port import Storage

Progress = Callable[[int, int], None]
"""Called with the states that are mapped and those there are."""


@dataclass(frozen=True, eq=False)
class Workbench:
    """The contexts of a fleet as terrains, each made when it is first asked for.

    Args:
        fleet: What to fly.
        storage, paths: Where contexts are, and where SSVs are cached by content.
        map_client, evaluator: Map() and Eval().
        progress: Told while Map() runs over a context.
        folder: Where the FleetSpec's own files are; the working directory when left out, as in a pod.
    """

    fleet: Fleet
    storage: Storage
    paths: FleetPaths
    map_client: MapClient
    evaluator: EvalClient
    progress: Progress | None = None
    folder: Path | None = None
    _terrains: dict[str, Terrain] = field(default_factory=dict, init=False, repr=False)

    @property
    def agents(self) -> tuple[AgentSpec, ...]:
        """The agents, with nothing left out but perhaps their starts."""
        return self.fleet.agents.resolved

    @property
    def energy(self) -> EnergyModel:
        """Energy and time of aircraft and edge machine."""
        return energy_model(self.fleet, self.folder)

    def terrain(self, name: str) -> Terrain:
        """The terrain of a context.

        Raises:
            ContextError: the context is not a good one.
            FunctionError: Map() fails in a state.
            MissionError: the agents do not fit on it.
        """
        if name not in self._terrains:
            self._terrains[name] = self._make(name)
        return self._terrains[name]

    def terrains(self, use: ContextUse) -> tuple[Terrain, ...]:
        """The terrains of all contexts for one use, in the order of the FleetSpec; errors as in `terrain`."""
        return tuple(self.terrain(context.name) for context in self.fleet.contexts_for(use))

    def grounds(self, use: ContextUse) -> Grounds:
        """What shaping and training take: the terrains for one use, and what judges missions over them."""
        names = tuple(agent.name for agent in self.agents)
        return Grounds(self.terrains(use), names, self.energy, self.evaluator)

    def _make(self, name: str) -> Terrain:
        context = load_context(self.storage, self.paths.context(name))
        environment = context.environment
        cache_path = self.paths.mapped(environment.digest, self.map_client.version)
        ssv = survey(context, self.map_client, self.storage, cache_path, self.progress)
        agents = self.agents
        if name != self.fleet.state_space.context:
            agents = tuple(_placed(agent, environment.grid) for agent in agents)
        return Terrain(environment, self.map_client.features, ssv, layout_of(environment.grid, self.fleet, agents))


def _placed(agent: AgentSpec, grid: Grid) -> AgentSpec:
    """The agent without a start that another field does not have: starts are cells of the field that is flown."""
    start = agent.start
    if start is None or (start.row < grid.rows and start.column < grid.columns):
        return agent
    return agent.model_copy(update={"start": None})

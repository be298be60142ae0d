"""A small field on which SA has something to learn, for tests of shaping and training.

The SSV of a cell says where in its group the cell is and how rich it is. Rich cells are those of the group's middle
row. Eval() asks for rich cells and counts moves, so a policy that seeks rich cells reaches more at the same cost.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from fleet.contexts.base import Environment
from fleet.contexts.grid import Grid
from fleet.energy.accounting import EnergyModel
from fleet.energy.profiles import load_aircraft, load_edge
from fleet.functions.contract import Evaluation, FeatureSpace, Metrics
from fleet.learning.practice import Grounds
from fleet.missions.layout import plan_layout
from fleet.simulator.terrain import Terrain
from fleet.spec.resources import Fleet

FEATURES = ("rich", "row", "column")


@dataclass(frozen=True)
class RichCells:
    """Eval() of the field; may be told to take its time, so that a test can interrupt it."""

    delay_s: float = 0.0
    version: str = "1"

    def evaluate(self, fs: FeatureSpace, metrics: Metrics, agent: str = "") -> Evaluation:
        time.sleep(self.delay_s)
        rich = fs.feature("rich") > 0.5
        all_rich = float((fs.environment.grid.rows // 3) * fs.environment.grid.columns)
        values = {"found": float(rich.sum()) / all_rich, "uav_energy_j": metrics.uav_energy_j}
        return Evaluation(finished=metrics.explored, metrics=values)


def field_fleet(**changes: object) -> Fleet:
    """A FleetSpec for the field; little of everything, so that tests are quick."""
    document: dict[str, object] = {
        "agents": {"count": 2},
        "stateSpace": {"context": "field"},
        "map": {"function": "field:map_observation"},
        "eval": {"function": "field:evaluate"},
        "contexts": [{"name": "field", "uri": "field"}],
        "goals": [{"metric": "found", "atLeast": 0.6}],
        "rewardShaping": {"epochs": 12, "batch": 4, "missions": 8},
        "training": {"epochs": 3, "missions": 16},
    }
    return Fleet.model_validate(document | changes)


def field_terrain(fleet: Fleet, seed: int = 0, rows: int = 9, columns: int = 12) -> Terrain:
    """The field; the seed changes how rich its cells are, a little."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    rich = (row % 3 == 1) * 0.8 + np.random.default_rng(seed).random(rows * columns) * 0.2
    valid = np.ones((rows, columns), dtype=np.bool_)
    valid[0, columns - 1] = False
    ssv = np.column_stack([rich, (row % 3) / 2.0, (column % 3) / 2.0])
    ssv[~valid.ravel()] = np.nan
    grid = Grid(valid)
    environment = Environment(f"field-{seed}", f"digest-{seed}", grid)
    return Terrain(environment, FEATURES, ssv, plan_layout(grid, fleet.state_space, fleet.agents.resolved))


def field_grounds(fleet: Fleet, contexts: int = 1, delay_s: float = 0.0) -> Grounds:
    """The field in several years."""
    energy = EnergyModel(load_aircraft("spark-survey"), load_edge("laptop-i5"))
    terrains = tuple(field_terrain(fleet, seed) for seed in range(contexts))
    return Grounds(terrains, tuple(agent.name for agent in fleet.agents.resolved), energy, RichCells(delay_s))

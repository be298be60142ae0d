"""Fields to scout for benchmarks of learning between missions: synthetic ones, and the real corn field."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from fleet.contexts.base import Environment
from fleet.contexts.grid import Grid
from fleet.energy.accounting import EnergyModel
from fleet.energy.profiles import load_aircraft, load_edge
from fleet.functions.evaluation import truth_metrics
from fleet.functions.extrapolation import neighbour_mean
from fleet.learning.blend import blend
from fleet.learning.experience import from_trace
from fleet.learning.goals import Objective
from fleet.learning.model import Fit, SAModel
from fleet.learning.qlearning import QLearning
from fleet.learning.reward import Normaliser, RewardModel
from fleet.missions.accounting import part_cells
from fleet.missions.layout import MOVES, Layout, plan_layout
from fleet.missions.records import Record
from fleet.simulator.batch import Batch, Flown, fly
from fleet.spec.learning import SASpec
from fleet.spec.swarm import Agents, Goal, Groups, StateSpace
from fleet.usefulness.loss import Effort, MissionLoss, effort, full_energy_j

AGENTS = [f"agent-{number}" for number in range(1, 5)]
FEATURES = ("exg", "lai", "brightness")
ENERGY = EnergyModel(load_aircraft("spark-survey"), load_edge("laptop-i5"))
TRAINED_ON = {"2018-06-01": "2018-09-16", "2018-08-02": "2018-06-01", "2018-09-16": "2018-08-02"}


@dataclass(frozen=True, eq=False)
class Field:
    """A field with the SSV of each cell, and the true quantity, which is the first feature."""

    environment: Environment
    layout: Layout
    ssv: NDArray[np.float64]


def corn(date: str, data: Path) -> Field:
    """The real field: pictures in a cell are averaged."""
    sums: dict[tuple[int, int], list[list[float]]] = defaultdict(list)
    with (data / "corn-cube" / f"{date}.csv").open() as file:
        for row in csv.DictReader(file):
            sums[int(row["row"]), int(row["col"])].append([float(row[name]) for name in FEATURES])
    cube = np.full((max(r for r, _ in sums) + 1, max(c for _, c in sums) + 1, len(FEATURES)), np.nan)
    for (row, column), values in sums.items():
        cube[row, column] = np.mean(values, axis=0)
    return field_of(date, cube)


def synthetic(seed: int) -> Field:
    """A smooth random field of 36 x 30 cells with noise; the second feature follows it, the third does not."""
    generator = np.random.default_rng(seed)

    def smooth(width: float) -> NDArray[np.float64]:
        values = gaussian_filter(generator.normal(size=(36, 30)), width)
        return np.asarray(values / values.std())

    truth = 100 + 12 * (0.9 * smooth(2.5) + 0.45 * generator.normal(size=(36, 30)))
    cube = np.stack([truth, 0.01 * truth + 0.1 * generator.normal(size=truth.shape), smooth(1.5)], axis=2)
    cube[generator.random(truth.shape) < 0.05] = np.nan
    return field_of(f"synthetic-{seed}", cube)


def field_of(name: str, cube: NDArray[np.float64]) -> Field:
    grid = Grid(np.isfinite(cube).all(axis=2), 11.9, 8.9)
    space = StateSpace(context="field", groups=Groups(rows=4, columns=4))
    layout = plan_layout(grid, space, Agents(count=4).resolved)
    return Field(Environment(name, name, grid, "exg", cube[..., 0]), layout, cube.reshape(-1, cube.shape[2]))


def batch_of(
    field: Field, reward: RewardModel, scores: NDArray[np.float64], exploration: float, missions: int
) -> Batch:
    """Missions in which each agent has its own score table, or all have the only one."""
    tables = np.arange(len(AGENTS)) % len(scores)
    return Batch(
        scores=scores,
        table=np.tile(tables, (missions, 1)),
        rewards=reward.reward(np.nan_to_num(field.ssv))[None],
        reward_of=np.zeros(missions, np.int64),
        utility_thresholds=np.full(missions, reward.utility_threshold),
        visited_thresholds=np.full(missions, reward.visited_threshold, np.int64),
        exploration=np.full(missions, exploration),
        missions=np.arange(missions),
    )


def scores_of(model: SAModel, ssv: NDArray[np.float64]) -> NDArray[np.float64]:
    table = np.zeros((len(ssv), len(MOVES)))
    valid = np.isfinite(ssv).all(axis=1)
    table[valid] = model.scores(ssv[valid])
    return table


def trained(field: Field, reward: RewardModel, seed: int) -> QLearning:
    """SA after simulated missions over a field."""
    model = QLearning.blank(SASpec(), FEATURES, reward.normaliser, seed)
    for turn in range(4):
        scores = scores_of(model, field.ssv)[None]
        flown = fly(field.layout, batch_of(field, reward, scores, 1.0 if turn == 0 else 0.3, 4), traced=True)
        assert flown.trace is not None
        rewards = reward.reward(np.nan_to_num(field.ssv))
        model = model.updated(from_trace(flown.trace, field.ssv, rewards), Fit(epochs=2, seed=seed + turn))
    return model


@dataclass(frozen=True, eq=False)
class Outcome:
    """A flown mission."""

    loss: float
    accuracy: float
    energy_j: float
    believed: MissionLoss
    efforts: dict[str, Effort]
    logs: dict[str, tuple[Record, ...]]

    @property
    def smooth(self) -> float:
        """The loss without its jump at the goal."""
        return self.believed.of(self.believed.whole)


@dataclass(frozen=True, eq=False)
class World:
    """The field as it is in one mission, and what is demanded."""

    field: Field
    reward: RewardModel
    objective: Objective

    def fly(self, weights: Mapping[str, Mapping[str, float]], models: Mapping[str, SAModel], log: bool) -> Outcome:
        """Fly and evaluate with the truth."""
        field = self.field
        tables = {key: scores_of(model, field.ssv) for key, model in models.items()}
        scores = np.stack([blend(tables, weights[agent]) for agent in AGENTS])
        flown = fly(field.layout, batch_of(field, self.reward, scores, 0.0, 1), traced=True)
        energies = [ENERGY.flight(flown.counts(0, n)).energy_j for n in range(4)]
        grid = field.environment.grid
        seen = np.where(flown.captured[0], field.ssv[:, 0], np.nan).reshape(grid.rows, grid.columns)
        metrics = truth_metrics(neighbour_mean(seen, grid), field.environment)
        metrics["uav_energy_j"] = sum(energies)
        sizes = [part_cells(field.layout, n) for n in range(4)]
        all_j = sum(full_energy_j(field.layout, n, ENERGY) for n in range(4))
        captures = flown.captures[0].tolist()
        efforts = {a: effort(field.layout, n, captures[n], energies[n], ENERGY) for n, a in enumerate(AGENTS)}
        whole = Effort(sum(captures) / sum(sizes), sum(energies) / all_j)
        believed = MissionLoss(self.objective, metrics, whole, all_j)
        logs = records_of(flown, field) if log else {}
        loss = self.objective.loss(metrics, all_j)
        return Outcome(loss, metrics["accuracy"], sum(energies), believed, efforts, logs)


def records_of(flown: Flown, field: Field) -> dict[str, tuple[Record, ...]]:
    """The logs that the workflows would have left."""
    trace = flown.trace
    assert trace is not None
    logs = {}
    for n, agent in enumerate(AGENTS):
        records = []
        for step in range(int(trace.steps[0, n])):
            cell, captured = int(trace.cell[0, n, step]), bool(trace.captured[0, n, step])
            row, column = field.environment.grid.position(cell)
            ssv = tuple(field.ssv[cell].tolist()) if captured else ()
            legal, move = int(trace.legal[0, n, step]), int(trace.move[0, n, step])
            records.append(Record(step, cell, row, column, captured, ssv, legal, move, "", 0.0, 0.0))
        logs[agent] = tuple(records)
    return logs


def shaken(world: World, seed: int) -> World:
    """The same field on another day: SSVs vary a little, and so does the truth."""
    ssv = world.field.ssv
    noise = np.random.default_rng(seed).normal(size=ssv.shape) * 0.1 * np.nanstd(ssv, axis=0)
    return replace(world, field=replace(world.field, ssv=ssv + noise))


def alone(world: World, model: SAModel) -> Outcome:
    """Every agent flies with one model."""
    return world.fly({agent: {"it": 1.0} for agent in AGENTS}, {"it": model}, log=False)


def world_of(name: str, seed: int, data: Path) -> tuple[World, World]:
    """The field that is flown, and the one that SA was trained on."""
    flown = synthetic(seed) if name == "synthetic" else corn(name, data)
    known = synthetic(seed + 500) if name == "synthetic" else corn(TRAINED_ON[name], data)
    normaliser = Normaliser.over([known.ssv])
    weights = tuple(np.random.default_rng(seed).random(len(FEATURES)).tolist())
    reward = RewardModel(
        features=FEATURES, weights=weights, normaliser=normaliser, utility_threshold=0.45 * 8 * sum(weights),
        visited_threshold=9, loss=0.0, goals_met=True,
    )  # fmt: skip
    return World(flown, reward, objective(0.7)), World(known, reward, objective(0.7))


def objective(accuracy: float) -> Objective:
    return Objective((Goal(metric="accuracy", at_least=accuracy),), "uav_energy_j")

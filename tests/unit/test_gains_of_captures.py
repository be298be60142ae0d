"""What captures brought, counted again from maps that are made anew, and what a Planner learns from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from fleet.contexts.grid import Grid
from fleet.functions.belief import Belief
from fleet.functions.classes import class_probabilities, classes, likely_values
from fleet.functions.kriging import Prediction, Variogram, fit, predict
from fleet.learning.planner import Evidence, PlannerModel
from fleet.learning.planner_lessons import first_planner, retrain_planner, train_planner
from fleet.learning.practice import Grounds
from fleet.learning.progress import Progress
from fleet.learning.reward import Normaliser, PlannerReward, RewardModel
from fleet.learning.run import Run
from fleet.missions.layout import plan_field
from fleet.missions.records import Record
from fleet.planning.gains import FARTHEST, MOST, gains
from fleet.planning.interest import FEW
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import InterestWeights, Tactics
from fleet.randomness import named_seed
from fleet.simulator.terrain import Terrain
from fleet.spec.swarm import AgentSpec
from fleet.storage.local import LocalStorage
from tests.learning_field import RichCells
from tests.planning import ENERGY, Values, drawn, environment

USUAL = InterestWeights()
REWARD = RewardModel(
    features=("brightness", "exg"), weights=(0.0, 0.0), normaliser=Normaliser(low=(0.0, 0.0), high=(1.0, 1.0)),
    utility_threshold=0.0, visited_threshold=0, loss=0.0, goals_met=True,
    planner=PlannerReward(feature="exg", weights=USUAL, goal=0.95, caution=0.5),
)  # fmt: skip


class PlainMap:
    """Kriging from scratch after each capture; the covariance is fitted anew after a quarter more captures."""

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        self.seen = np.full(grid.valid.shape, np.nan)
        self.variogram = Variogram(1.0, 0.0, 0.0)
        self.fitted_to = 0

    @property
    def known(self) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        return np.isfinite(self.seen)

    @property
    def map(self) -> Prediction:
        values, deviation = self.seen.copy(), np.where(self.grid.valid, 0.0, np.nan)
        wanted = self.grid.valid & ~self.known
        if wanted.any():
            values[wanted], deviation[wanted] = predict(self.seen, self.known, wanted, self.grid, self.variogram)
        return Prediction(values, deviation)

    def take_in(self, cell: int, value: float) -> bool:
        """Whether the covariance was fitted anew."""
        surprised = self.variogram.variance == 0.0 and self.known.any() and value != float(np.nanmean(self.seen))
        self.seen.flat[cell] = value
        if not surprised and np.count_nonzero(self.known) < 1.25 * self.fitted_to:
            return False
        before, self.variogram = self.variogram, fit(self.seen, self.known, self.grid)
        self.fitted_to = int(np.count_nonzero(self.known))
        return self.variogram != before

    def features(self, cell: int) -> list[float]:
        here = self.map
        probable = class_probabilities(here, float(here.values[self.grid.valid].mean())).max(axis=0)
        doubt = np.where(self.known | ~self.grid.valid, 0.0, 1.0 - probable)
        row, column = self.grid.position(cell)
        away = [np.hypot(r - row, c - column) for r, c in np.argwhere(self.known)]
        around = total = 0.0
        for down, right in product(range(-3, 4), repeat=2):
            if (down, right) != (0, 0):
                share = np.exp(-np.hypot(down, right) / 1.5)
                total += share
                if 0 <= row + down < self.grid.rows and 0 <= column + right < self.grid.columns:
                    around += share * doubt[row + down, column + right]
        return [float(doubt[row, column]), around / total, 1.0 - float(np.exp(-min(away) / 3.0))]


def plainly(grid: Grid, cells: Sequence[int], known: Values) -> tuple[list[list[float]], list[float]]:
    """`gains` of a short mission, all of whose captures are looked at."""
    plain, mean = PlainMap(grid), float(np.nanmean(known))
    told = np.isfinite(known)
    stands_for = np.count_nonzero(grid.valid) / np.count_nonzero(told)
    features, brought = [], []

    def right_cells(besides: int) -> tuple[bool, int]:
        right = (classes(likely_values(plain.map, mean), mean).reshape(-1) == classes(known, mean)) & told
        return bool(right[besides]), int(right.sum()) - int(right[besides])

    for cell in cells:
        new = np.isnan(plain.seen.flat[cell])
        looked_at = new and np.count_nonzero(plain.known) >= FEW
        if looked_at:
            before, believed = right_cells(cell), plain.features(cell)
        fitted = plain.take_in(cell, float(known[cell])) if new else False
        if looked_at and not fitted:
            after = right_cells(cell)
            features.append(believed)
            one = after[0] - before[0] + stands_for * (after[1] - before[1])
            brought.append(min(FARTHEST, max(-FARTHEST, one)))
    return features, brought


def with_holes() -> Values:
    truth = drawn(4, 9, 10)
    truth[2:4, 5:7] = np.nan
    return truth


@pytest.mark.parametrize("share", [1.0, 0.6])
@pytest.mark.parametrize("truth", [drawn(1, 9, 10), drawn(2, 7, 12), with_holes()], ids=["a", "b", "holes"])
def test_what_captures_brought_is_what_maps_made_anew_say(truth: Values, share: float) -> None:
    """All of a context may be known in the end, or what was captured alone."""
    place = environment(truth)
    order = np.random.default_rng(3).permutation(np.flatnonzero(np.isfinite(truth)))
    cells = order[: int(share * len(order))].tolist()
    known = truth.reshape(-1).copy()
    if share < 1.0:
        known[order[len(cells) :]] = np.nan
    features, brought = gains(Belief(place.grid), cells, known)
    slow_features, slow_brought = plainly(place.grid, cells, known)
    assert len(brought) > 20
    assert features == pytest.approx(np.array(slow_features), abs=1e-9)
    assert brought == pytest.approx(np.array(slow_brought), abs=1e-9)
    assert brought.min() <= 0.0 < brought.max()


def test_a_cell_that_is_captured_again_brings_nothing_and_does_not_count() -> None:
    truth = drawn(1, 9, 10)
    cells = np.random.default_rng(3).permutation(truth.size).tolist()
    twice = [cell for pair in zip(cells, [cells[0], *cells], strict=False) for cell in pair]
    once = gains(Belief(environment(truth).grid), cells, truth.reshape(-1))
    again = gains(Belief(environment(truth).grid), twice, truth.reshape(-1))
    np.testing.assert_array_equal(again[0], once[0])
    np.testing.assert_array_equal(again[1], once[1])


@pytest.mark.parametrize("count", [1, FEW - 1, FEW])
def test_the_first_captures_say_nothing(count: int) -> None:
    truth = drawn(1, 9, 10)
    features, brought = gains(Belief(environment(truth).grid), list(range(count)), truth.reshape(-1))
    assert (features.shape, brought.shape) == ((0, 3), (0,))


def test_of_many_captures_some_are_looked_at_evenly() -> None:
    truth = drawn(2, 24, 28)
    cells = np.random.default_rng(1).permutation(truth.size).tolist()
    features, brought = gains(Belief(environment(truth).grid), cells, truth.reshape(-1))
    assert MOST - 25 <= len(brought) < MOST
    assert np.abs(brought).max() <= FARTHEST
    novelty = features[:, 2]  # it falls as the field fills: looks at the first captures alone would say otherwise
    assert novelty[:40].mean() > 1.15 * novelty[-40:].mean()
    assert novelty[-1] == pytest.approx(1.0 - np.exp(-1.0 / 3.0))


# what is learned from it


def log(cells: Sequence[int], truth: Values, seconds: float = 6.0) -> tuple[Record, ...]:
    """Captures of one agent, of which brightness says nothing."""
    return tuple(
        Record(i, cell, *divmod(cell, truth.shape[1]), True, (7.0, float(truth.flat[cell])), 0, 0, "", i * seconds, 0)
        for i, cell in enumerate(cells)
    )


def banded(rows: int = 20, columns: int = 26) -> Values:
    """Poor on one side and rich on the other, and in between a band of cells on the bounds of the classes."""
    truth = np.full((rows, columns), 40.0)
    truth[:, columns // 2 :] = 160.0
    band = slice(columns // 2 - 3, columns // 2 + 3)
    truth[:, band] = np.random.default_rng(2).choice([75.0, 85.0, 95.0, 105.0], (rows, 6))
    return truth


def scattered_cells(truth: Values, seed: int) -> list[int]:
    return np.random.default_rng(seed).permutation(truth.size)[: truth.size // 2].tolist()


def learned(truth: Values, missions: int) -> InterestWeights:
    """What a model makes of some missions that captured half of a field here and there."""
    model = first_planner(REWARD)
    for seed in range(missions):
        cells = scattered_cells(truth, seed)
        model, count = retrain_planner(model, {"a": log(cells, truth)}, environment(truth), REWARD)
        assert 100 < count < MOST
    return model.interest


def test_captures_in_a_band_of_doubt_bring_more_and_doubt_gains_weight_over_novelty() -> None:
    truth = banded()
    features, brought = gains(Belief(environment(truth).grid), scattered_cells(truth, 0), truth.reshape(-1))
    doubtful = features[:, 0] > 0.3
    assert brought[doubtful].mean() > brought[~doubtful].mean() + 0.2
    found = learned(truth, missions=6)
    assert found.doubt / found.novelty > 1.25 * USUAL.doubt / USUAL.novelty


def test_a_mission_over_white_noise_hardly_moves_the_weights() -> None:
    moved = []
    for seed in range(8):
        found = learned(np.random.default_rng(seed).normal(100.0, 25.0, (20, 26)), missions=1)
        moved.append(
            [
                found.doubt_around / found.doubt / (USUAL.doubt_around / USUAL.doubt),
                found.novelty / found.doubt / (USUAL.novelty / USUAL.doubt),
            ]
        )
    assert np.array(moved) == pytest.approx(np.ones((8, 2)), abs=0.15)
    assert np.mean(moved, axis=0) == pytest.approx(np.ones(2), abs=0.05)


def test_a_subset_learns_from_its_agents_captures_in_the_order_of_mission_time() -> None:
    truth = drawn(5, 12, 14)
    place, first = environment(truth), first_planner(REWARD)
    swarm = Swarm(Belief(place.grid), ENERGY, scattered(place.grid, 2, 1), Tactics())
    swarm.fly(truth.item)
    logs = {f"agent-{index + 1}": tuple(flown(swarm, index, truth)) for index in range(2)}
    together, count = retrain_planner(first, logs, place, REWARD)
    merged = [record.cell for record in sorted((r for log in logs.values() for r in log), key=lambda r: r.time_s)]
    features, brought = gains(Belief(place.grid), merged, truth.reshape(-1))
    assert count == together.captures == len(brought)
    assert together.moments == pytest.approx(features.T @ features)
    assert together.products == pytest.approx(features.T @ brought)
    alone, of_one = retrain_planner(first, {"agent-1": logs["agent-1"]}, place, REWARD)
    assert 0 < of_one < count
    assert not np.allclose(alone.moments, together.moments)


def flown(swarm: Swarm, index: int, truth: Values) -> list[Record]:
    """Captures of one agent, at times of its own."""
    trace = swarm.traces[index]
    cells = [cell for cell, fresh in zip(trace.cells, trace.captured, strict=True) if fresh]
    return list(log(cells, truth, seconds=6.0 + 0.1 * index))


@pytest.mark.parametrize("logs", [{}, {"agent-1": ()}])
def test_without_captures_the_model_stays_what_it_was(logs: Mapping[str, Sequence[Record]]) -> None:
    first = first_planner(REWARD)
    model, count = retrain_planner(first, logs, environment(drawn(1)), REWARD)
    assert (model.to_bytes(), count) == (first.to_bytes(), 0)


def test_training_learns_from_simulated_missions_over_each_context(tmp_path: Path) -> None:
    terrains = tuple(terrain(drawn(seed, 9, 10)) for seed in (1, 2))
    grounds, first = Grounds(terrains, ("agent-1", "agent-2"), ENERGY, RichCells()), first_planner(REWARD)
    nothing = Grounds((), ("agent-1", "agent-2"), ENERGY, RichCells())

    def trained(missions: int = 2, workers: int = 1, seed: int = 3, over: Grounds = grounds) -> PlannerModel:
        news: list[Progress] = []
        run = Run(LocalStorage(tmp_path), "training", seed, workers, listener=news.append)
        model = train_planner(first, over, REWARD, missions, run)
        flights = missions * len(over.terrains)
        assert [one.done for one in news] == ([flights] if flights else [])
        return model

    model = trained()
    assert model.to_bytes() == trained(workers=2).to_bytes() != trained(seed=4).to_bytes()
    assert model.captures > trained(missions=1).captures > 30
    assert trained(over=nothing).to_bytes() == first.to_bytes()
    plain = first
    for number, one in product(range(2), terrains):
        truth = one.environment.truth
        assert truth is not None
        scouts = scattered(one.environment.grid, 2, named_seed(3, f"training/{number}"))
        swarm = Swarm(Belief(one.environment.grid), ENERGY, scouts, Tactics(weights=USUAL), REWARD.of_planner.rule)
        swarm.fly(truth.item)
        plain = plain.updated(Evidence(*gains(Belief(one.environment.grid), swarm.captured, truth.reshape(-1))))
    assert model.to_bytes() == plain.to_bytes()


def terrain(truth: Values) -> Terrain:
    place = environment(truth)
    ssv = np.stack((np.full(truth.size, 7.0), truth.reshape(-1)), axis=1)
    agents = [AgentSpec(name="agent-1"), AgentSpec(name="agent-2")]
    return Terrain(place, REWARD.features, ssv, plan_field(place.grid, agents))

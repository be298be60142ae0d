"""Batches that do not fit are refused, and simulated missions are evaluated like flown ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

from fleet.contexts.base import Environment
from fleet.contexts.grid import Grid
from fleet.energy.accounting import EnergyModel, FlightCounts
from fleet.energy.profiles import load_aircraft, load_edge
from fleet.errors import MissionError
from fleet.functions.contract import AgentMetrics, Evaluation, FeatureSpace, Metrics
from fleet.missions.accounting import agent_metrics
from fleet.missions.layout import Layout, plan_layout
from fleet.simulator import reference
from fleet.simulator.batch import Batch, fly
from fleet.simulator.evaluation import evaluate_missions
from fleet.simulator.terrain import Terrain
from fleet.spec.swarm import CARDINAL, AgentSpec, GroupOrder, Groups, StateSpace

ENERGY = EnergyModel(load_aircraft("spark-survey"), load_edge("laptop-i5"))


def layout_of(rows: int, columns: int, group: tuple[int, int], agents: int) -> Layout:
    space = StateSpace(context="field", groups=Groups(rows=group[0], columns=group[1]))
    specs = [AgentSpec(name=f"a{i}", actions=CARDINAL) for i in range(agents)]
    return plan_layout(Grid(np.ones((rows, columns), dtype=np.bool_)), space, specs)


def batch_of(layout: Layout, missions: int = 2, visited: int = 1000) -> Batch:
    cells = layout.grid.cells
    return Batch(
        scores=np.zeros((1, cells, 8)),
        table=np.zeros((missions, layout.agents), dtype=np.int64),
        rewards=np.zeros((1, cells)),
        reward_of=np.zeros(missions, dtype=np.int64),
        utility_thresholds=np.full(missions, np.inf),
        visited_thresholds=np.full(missions, visited, dtype=np.int64),
        exploration=np.zeros(missions),
        missions=np.arange(missions),
    )


LAYOUT = layout_of(2, 4, (2, 2), 2)
GOOD = batch_of(LAYOUT)


@pytest.mark.parametrize("form", [fly, reference.fly])
@pytest.mark.parametrize(
    ("batch", "message"),
    [
        (replace(GOOD, scores=np.zeros((1, 8, 4))), r"scores has the shape \(1, 8, 4\), but \(1, 8, 8\) fits"),
        (replace(GOOD, exploration=np.zeros(3)), r"exploration has the shape \(3,\), but \(2,\) fits"),
        (replace(GOOD, table=np.full((2, 2), 1)), r"table must be in 0\.\.0"),
        (replace(GOOD, reward_of=np.array([0, -1])), r"reward_of must be in 0\.\.0"),
        (replace(GOOD, scores=np.full((1, 8, 8), np.nan)), "score table 0 has NaN for a move in a cell with data"),
    ],
)
def test_a_batch_that_does_not_fit_is_refused(
    form: Callable[[Layout, Batch], object], batch: Batch, message: str
) -> None:
    with pytest.raises(MissionError, match=message):
        form(LAYOUT, batch)


def test_no_missions_are_no_problem() -> None:
    flown = fly(LAYOUT, batch_of(LAYOUT, missions=0), traced=True)
    assert flown.captured.shape == (0, 8)
    assert flown.trace is not None
    assert flown.trace.cell.shape == (0, 2, 0)


def test_groups_wider_than_a_word_are_refused() -> None:
    groups = Groups.model_construct(rows=1, columns=65, order=GroupOrder.ROW_MAJOR)
    space = StateSpace.model_construct(context="field", groups=groups, capture_in_transit=True)
    grid = Grid(np.ones((1, 65), dtype=np.bool_))
    layout = plan_layout(grid, space, [AgentSpec(name="a", actions=CARDINAL)])
    with pytest.raises(MissionError, match="at most 64 columns"):
        fly(layout, batch_of(layout))


def test_the_largest_groups_that_a_spec_may_have_are_flown_exactly() -> None:
    layout = layout_of(70, 130, (64, 64), 2)
    generator = np.random.default_rng(0)
    batch = replace(batch_of(layout), scores=generator.random((1, 70 * 130, 8)), exploration=np.array([0.0, 0.3]))
    np.testing.assert_array_equal(fly(layout, batch).moves, reference.fly(layout, batch).moves)


def test_counts_are_what_accounting_takes() -> None:
    assert fly(LAYOUT, GOOD).counts(1, 0) == FlightCounts(
        moves=(1, 1, 1, 0, 0, 0, 0, 0), captures=4, decisions=3, steps=4
    )


@dataclass
class Recording:
    """Eval() that keeps what it was asked."""

    version: ClassVar[str] = "1"
    asked: list[tuple[FeatureSpace, Metrics]] = field(default_factory=list)

    def evaluate(self, fs: FeatureSpace, metrics: Metrics, agent: str = "") -> Evaluation:
        self.asked.append((fs, metrics))
        return Evaluation(finished=False, metrics={"states": float(len(fs))})


def test_eval_gets_what_all_agents_captured_and_what_each_of_them_spent() -> None:
    ssv: NDArray[np.float64] = np.arange(16.0).reshape(8, 2)
    terrain = Terrain(Environment("field", "d", LAYOUT.grid), ("a", "b"), ssv, LAYOUT)
    flown = fly(LAYOUT, batch_of(LAYOUT, missions=1, visited=1))
    evaluator = Recording()
    evaluations = evaluate_missions(terrain, flown, ["x", "y"], ENERGY, evaluator)
    assert [evaluation.metrics for evaluation in evaluations] == [{"states": 4.0}]
    ((fs, metrics),) = evaluator.asked
    assert fs.states.tolist() == [0, 2, 4, 6]
    assert fs.ssv.tolist() == ssv[[0, 2, 4, 6]].tolist()
    assert metrics == Metrics(
        tuple(
            agent_metrics(name, flown.counts(0, agent), ENERGY, groups=1, explored=1)
            for agent, name in enumerate(["x", "y"])
        )
    )


def test_accounting_adds_up_what_the_energy_model_says() -> None:
    counts = FlightCounts(moves=(3, 2, 1, 0, 0, 0, 0, 0), captures=5, decisions=4, steps=7)
    cost = ENERGY.flight(counts)
    assert agent_metrics("a", counts, ENERGY, groups=3, explored=2) == AgentMetrics(
        agent="a",
        steps=7,
        captures=5,
        time_s=cost.time_s,
        uav_energy_j=cost.energy_j,
        edge_energy_j=ENERGY.edge_energy_j(counts, cost.time_s),
        groups=3,
        groups_explored=2,
    )

from __future__ import annotations

import tracemalloc
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from fleet.contexts.grid import Grid
from fleet.energy.accounting import EnergyModel, FlightCounts
from fleet.energy.profiles import load_aircraft, load_edge
from fleet.errors import MissionError
from fleet.learning.goals import Objective
from fleet.learning.model import Fit, SAModel, Transitions
from fleet.learning.reward import Normaliser, RewardModel
from fleet.missions.accounting import part_cells
from fleet.missions.layout import MOVES, Layout, plan_layout
from fleet.missions.records import Record
from fleet.spec.learning import SAKind
from fleet.spec.swarm import Action, AgentSpec, Goal, Groups, StateSpace
from fleet.usefulness.belief import believed_ssv
from fleet.usefulness.loss import Effort, MissionLoss, effort, full_energy_j, thorough_costs
from fleet.usefulness.replay import Replayer, fly_alone

ENERGY = EnergyModel(load_aircraft("spark-survey"), load_edge("laptop-i5"))
GRID = Grid(np.ones((6, 12), dtype=np.bool_), 10.0, 10.0)
AGENTS = ("agent-1", "agent-2")
MOVES_OF_AGENTS = (Action.NORTH, Action.SOUTH, Action.EAST, Action.WEST)
LAYOUT: Layout = plan_layout(
    GRID,
    StateSpace(context="field", groups=Groups(rows=6, columns=6)),
    [AgentSpec(name=name, actions=MOVES_OF_AGENTS) for name in AGENTS],
)
REWARD = RewardModel(
    features=("green",), weights=(1.0,), normaliser=Normaliser(low=(0.0,), high=(1.0,)), utility_threshold=4.0,
    visited_threshold=30, loss=0.0, goals_met=True,
)  # fmt: skip
OBJECTIVE = Objective((Goal(metric="accuracy", at_least=0.7),), "uav_energy_j")


@dataclass(frozen=True)
class Prefers:
    """A model that prefers moves by a fixed order."""

    order: tuple[Action, ...]
    kind: SAKind = SAKind.Q_LEARNING
    features: tuple[str, ...] = ("green",)

    def scores(self, ssv: NDArray[np.float64]) -> NDArray[np.float64]:
        row = [float(len(self.order) - self.order.index(move)) if move in self.order else 0.0 for move in MOVES]
        return np.tile(row, (len(ssv), 1))

    def updated(self, transitions: Transitions, fit: Fit) -> SAModel:
        return self

    def to_bytes(self) -> bytes:
        return b""


ROWS: SAModel = Prefers((Action.EAST, Action.WEST, Action.SOUTH, Action.NORTH))
COLUMNS: SAModel = Prefers((Action.SOUTH, Action.NORTH, Action.EAST, Action.WEST))


def captured(cells: dict[int, float]) -> tuple[Record, ...]:
    return tuple(
        Record(i, cell, *GRID.position(cell), True, (value,), 0, -1, "", 0.0, 0.0)
        for i, (cell, value) in enumerate(cells.items())
    )


def mission_loss(accuracy: float, whole: Effort) -> MissionLoss:
    return MissionLoss(
        OBJECTIVE, {"accuracy": accuracy, "uav_energy_j": 1000.0, "coverage": whole.captured}, whole, 2000.0
    )


# belief


def test_captured_states_keep_their_ssv_and_others_lie_between_their_neighbours() -> None:
    field = believed_ssv(GRID, {"agent-1": captured({0: 0.2}), "agent-2": captured({11: 0.8})})
    assert (field[0, 0], field[11, 0]) == (0.2, 0.8)
    assert np.isfinite(field).all()
    row = field[:12, 0]
    assert (np.diff(row) > 0).all()
    assert field[5, 0] == pytest.approx((0.2 / 5**2 + 0.8 / 6**2) / (1 / 5**2 + 1 / 6**2))


def test_states_without_data_are_not_believed_to_be_anything() -> None:
    valid = np.ones((2, 3), dtype=np.bool_)
    valid[1, 1] = False
    field = believed_ssv(Grid(valid), {"agent-1": captured({0: 0.5})})
    assert np.array_equal(field[:, 0], [0.5, 0.5, 0.5, 0.5, np.nan, 0.5], equal_nan=True)


def test_a_mission_that_captured_nothing_cannot_be_replayed() -> None:
    with pytest.raises(MissionError, match="captured nothing"):
        believed_ssv(GRID, {"agent-1": ()})


# loss


def test_effort_is_a_share_of_the_agents_own_part() -> None:
    assert [part_cells(LAYOUT, agent) for agent in range(2)] == [36, 36]
    all_j = full_energy_j(LAYOUT, 0, ENERGY)
    everything = FlightCounts((0, 0, 36, 0, 0, 0, 0, 0), captures=36, decisions=0, steps=37)
    assert all_j == pytest.approx(ENERGY.flight(everything).energy_j)
    assert effort(LAYOUT, 0, 18, all_j / 4, ENERGY) == Effort(0.5, 0.25)
    assert effort(LAYOUT, 0, 40, all_j, ENERGY) == Effort(1.0, 1.0)


@pytest.mark.parametrize("minimise", ["time_s", "uav_energy_j", "edge_energy_j", "energy_j"])
def test_half_of_a_thorough_mission_costs_a_half_whichever_cost_is_minimised(minimise: str) -> None:
    costs = thorough_costs(LAYOUT, ENERGY)
    thorough = FlightCounts((0, 0, 36, 0, 0, 0, 0, 0), captures=36, decisions=36, steps=37)
    assert costs["time_s"] == ENERGY.flight(thorough).time_s
    assert costs["uav_energy_j"] == pytest.approx(2 * ENERGY.flight(thorough).energy_j)
    goals = (Goal(metric="accuracy", at_least=0.7),)
    half = {"accuracy": 1.0, **{name: cost / 2 for name, cost in costs.items()}}
    loss = MissionLoss(Objective(goals, minimise), half, Effort(0.5, 0.5), costs[minimise])
    assert loss.of(Effort(0.5, 0.5)) == pytest.approx(0.5)
    assert loss.of(Effort(0.5, 0.25)) == pytest.approx(0.4)


def test_the_loss_of_what_all_agents_did_is_that_of_the_mission_when_goals_are_clearly_met_or_missed() -> None:
    whole = Effort(0.5, 0.6)
    for accuracy in (0.9, 0.4):
        loss = mission_loss(accuracy, whole)
        assert loss.of(whole) == pytest.approx(OBJECTIVE.loss(loss.metrics, 2000.0), abs=0.005)


def test_saving_energy_pays_only_while_the_goals_are_met() -> None:
    met, missed = mission_loss(0.9, Effort(0.5, 0.6)), mission_loss(0.6, Effort(0.5, 0.6))
    assert met.of(Effort(0.48, 0.5)) < met.of(Effort(0.5, 0.6))
    assert missed.of(Effort(0.48, 0.5)) > missed.of(Effort(0.5, 0.6)) > missed.of(Effort(0.55, 0.7))


def test_the_loss_rises_before_the_goal_is_missed() -> None:
    loss = mission_loss(0.72, Effort(0.5, 0.6))
    losses = [loss.of(Effort(captured_share, 0.6)) for captured_share in (0.60, 0.50, 0.48, 0.46, 0.40)]
    assert losses == sorted(losses)
    assert losses[0] < losses[2] < 1.0 < losses[4]


def test_metrics_are_carried_over_by_what_was_left_unseen() -> None:
    goals = (
        Goal(metric="coverage", at_least=0.9), Goal(metric="accuracy", at_least=0.9), Goal(metric="mae", at_most=1.0),
        Goal(metric="time_s", at_most=9.0), Goal(metric="yield_t", at_least=5.0),
    )  # fmt: skip
    metrics = {"coverage": 0.5, "accuracy": 0.8, "mae": 4.0, "time_s": 10.0, "yield_t": 3.0, "note": 1.0}
    loss = MissionLoss(Objective(goals), metrics, Effort(0.5, 0.5))
    assert loss.carried(Effort(0.75, 1.0)) == pytest.approx(
        {"coverage": 0.75, "accuracy": 0.95, "mae": 1.0, "time_s": 20.0, "yield_t": 3.0, "note": 1.0}
    )


def test_a_field_that_was_wholly_seen_says_nothing_of_seeing_less() -> None:
    loss = mission_loss(1.0, Effort(1.0, 1.0))
    assert loss.of(Effort(0.5, 1.0)) == loss.of(Effort(1.0, 1.0))


# replays


def replayer(before: SAModel, after: dict[str, SAModel]) -> Replayer:
    field = np.random.default_rng(4).random(GRID.cells)
    ssv = believed_ssv(GRID, {"agent-1": captured(dict(enumerate(field.tolist())))})
    whole = Effort(0.5, 0.6)
    return Replayer(
        LAYOUT, AGENTS, ssv, {agent: {"initial": 1.0} for agent in AGENTS}, {"initial": before}, after, REWARD, ENERGY,
        mission_loss(0.9, whole), dict.fromkeys(AGENTS, whole),
    )  # fmt: skip


def test_the_same_weights_and_models_have_the_loss_that_was_flown() -> None:
    replay = replayer(ROWS, {"initial": ROWS, "1": COLUMNS})
    for agent in AGENTS:
        found = replay(agent, [{"initial": 1.0, "1": 0.0}, {"initial": 0.0, "1": 1.0}])
        assert found[0] == pytest.approx(replay.loss.of(Effort(0.5, 0.6)))
        assert found[1] != pytest.approx(found[0])


def test_a_replay_is_the_agents_own_flight() -> None:
    replay = replayer(ROWS, {"initial": COLUMNS})
    rewards = REWARD.reward(replay.ssv)
    efforts = []
    for model in (ROWS, COLUMNS):
        flown = fly_alone(LAYOUT, 1, model.scores(replay.ssv)[None], REWARD, rewards)
        energy_j = ENERGY.flight(flown.counts(0, 0)).energy_j
        efforts.append(effort(LAYOUT, 1, int(flown.captures[0, 0]), energy_j, ENERGY))
        assert not flown.captured[0][np.concatenate(LAYOUT.groups[:1])].any()
    expected = replay.loss.of(Effort(0.5, 0.6).plus(efforts[1], minus=efforts[0]))
    assert replay("agent-2", [{"initial": 1.0}]) == [expected]


def test_many_replays_take_no_more_memory_than_some_and_say_the_same() -> None:
    replay = replayer(ROWS, {"initial": ROWS, "1": COLUMNS})
    few = [{"initial": 1 - share, "1": share} for share in (0.0, 0.2, 0.4, 0.9)]
    peaks, found = [], []
    for candidates in (few * 8, few * 64):
        tracemalloc.start()
        found.append(replay("agent-1", candidates))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert found[1] == found[0] * 8
    assert peaks[1] < 1.5 * peaks[0]


def test_weights_of_agents_do_not_touch_each_other() -> None:
    replay = replayer(ROWS, {"initial": ROWS, "1": COLUMNS})
    candidates = [{"initial": 1 - share, "1": share} for share in (0.0, 0.2, 0.9)]
    assert replay("agent-1", candidates) == [replay("agent-1", [each])[0] for each in candidates]

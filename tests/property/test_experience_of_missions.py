from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.contexts.grid import Grid
from fleet.learning.experience import choices, concatenate, empty, from_log, from_logs, from_trace
from fleet.learning.model import Transitions
from fleet.learning.reward import Normaliser, RewardModel
from fleet.missions.flight import Flight
from fleet.missions.history import ThresholdHA
from fleet.missions.layout import MOVES, Layout, plan_layout
from fleet.missions.records import Record
from fleet.simulator.batch import Batch
from fleet.simulator.reference import fly
from fleet.spec.swarm import Action, AgentSpec, Groups, StateSpace

REWARD = RewardModel(
    features=("a", "b"), weights=(0.7, 0.3), normaliser=Normaliser(low=(0.0, 0.0), high=(1.0, 1.0)),
    utility_threshold=2.0, visited_threshold=4, loss=0.0, goals_met=True,
)  # fmt: skip


def flown_log(layout: Layout, agent: int, ssv: np.ndarray, scores: np.ndarray, seed: int) -> list[Record]:
    """The log of one agent as a workflow would write it."""
    ha = ThresholdHA(REWARD.utility_threshold, REWARD.visited_threshold)
    flight = Flight(layout, agent, ha, seed=seed, exploration=0.3)
    records = []
    while not flight.landed:
        cell = flight.cell
        reward = float(np.nan_to_num(REWARD.reward(ssv[cell][None]))[0])
        decision = flight.decide(lambda cell=cell: scores[cell].tolist(), reward)
        captured = tuple(ssv[cell].tolist()) if decision.captured else ()
        row, column = layout.grid.position(cell)
        name = MOVES[decision.move].value if decision.move >= 0 else "Land"
        step, legal, move = decision.step, decision.legal, decision.move
        records.append(Record(step, cell, row, column, decision.captured, captured, legal, move, name, 0.0, 0.0))
    return records


def assert_same(one: Transitions, other: Transitions) -> None:
    for name in ("ssv", "moves", "rewards", "next_ssv", "next_legal"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.booleans())
def test_a_log_and_a_trace_of_the_same_mission_teach_the_same(seed: int, agents: int, transit: bool) -> None:
    generator = np.random.default_rng(seed)
    valid = generator.random((8, 9)) < 0.8
    valid[:, 0] = True
    grid = Grid(valid)
    ssv = np.where(valid.reshape(-1, 1), generator.random((72, 2)), np.nan)
    scores = generator.random((72, len(MOVES)))
    members = [AgentSpec(name=f"agent-{i}", actions=tuple(Action)[: 4 + 4 * (i % 2)]) for i in range(agents)]
    space = StateSpace(context="c", groups=Groups(rows=3, columns=3), capture_in_transit=transit)
    layout = plan_layout(grid, space, members)
    one = np.zeros(1, dtype=np.int64)
    batch = Batch(
        scores[None], np.zeros((1, agents), dtype=np.int64), np.nan_to_num(REWARD.reward(ssv))[None], one,
        np.array([REWARD.utility_threshold]), np.array([REWARD.visited_threshold]), np.array([0.3]), one, seed,
    )  # fmt: skip
    trace = fly(layout, batch, traced=True).trace
    assert trace is not None
    logs = [flown_log(layout, agent, ssv, scores, seed) for agent in range(agents)]
    simulated = from_trace(trace, ssv, REWARD.reward(ssv))
    assert_same(concatenate([from_log(log, REWARD) for log in logs]), simulated)
    assert_same(from_logs({f"agent-{i}": log for i, log in enumerate(logs)}, REWARD), simulated)
    assert np.isfinite(simulated.ssv).all()
    assert np.isfinite(simulated.next_ssv).all()
    few = choices(trace).sample(3, np.random.default_rng(0))
    assert len(few) == min(3, len(simulated))


def _record(step: int, cell: int, captured: bool, legal: int) -> Record:
    return Record(step, cell, 0, cell, captured, (0.1 * cell, 0.5) if captured else (), legal, 2, "East", 0.0, 0.0)


def test_states_captured_earlier_are_known_from_their_records() -> None:
    log = [_record(0, 1, True, 0), _record(1, 2, True, 0), _record(2, 1, False, 4), _record(3, 2, False, 0)]
    learned = from_log(log, REWARD)
    np.testing.assert_array_equal(learned.ssv, [[0.1, 0.5]])
    np.testing.assert_array_equal(learned.next_ssv, [[0.2, 0.5]])
    assert not learned.next_legal.any()


def test_a_log_that_ends_after_a_choice_does_not_count_that_choice() -> None:
    assert len(from_log([_record(0, 1, True, 4)], REWARD)) == 0
    assert len(from_log([], REWARD)) == 0
    assert len(from_logs({}, REWARD)) == 0
    assert_same(from_log([], REWARD), empty(2))


def test_travel_between_groups_is_no_choice() -> None:
    assert len(from_log([_record(0, 1, True, 0), _record(1, 2, True, 0)], REWARD)) == 0

"""Agents that plan together and know of each other what their logs say."""

from __future__ import annotations

import random
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from fleet.clock import ManualClock
from fleet.contexts.grid import Grid
from fleet.errors import MissionError, TrainingError
from fleet.functions.contract import AgentMetrics
from fleet.missions.documents import Landing
from fleet.missions.flight import LAND
from fleet.missions.records import Record
from fleet.runtime import hearing, scout_mind
from fleet.runtime.hearing import PATIENCE_S, Hearing, next_arrival_s
from fleet.runtime.pilot import Pilot
from fleet.storage.local import LocalStorage
from tests.planned_flights import PATHS, REWARD, fly, fly_one, log_of, prepared, put, settings_of, simulated
from tests.planning import Values, drawn, environment

pytestmark = pytest.mark.usefixtures("quick_disk")


PLACE = environment(drawn(1, 14, 16))


def in_two_pieces() -> Values:
    truth = drawn(3, 9, 15)
    truth[:, 5:10] = np.nan
    return truth


@pytest.mark.parametrize("agents", [1, 2, 5])
@pytest.mark.parametrize("truth", [drawn(1, 14, 16), drawn(2, 11, 9), in_two_pieces()], ids=["a", "b", "two pieces"])
def test_what_agents_fly_is_what_the_simulator_flies(tmp_path: Path, agents: int, truth: Values) -> None:
    storage = prepared(tmp_path, agents, truth)
    fly(storage)
    swarm = simulated(storage)
    for index, trace in enumerate(swarm.traces):
        records = log_of(storage, f"agent-{index + 1}")
        assert [record.cell for record in records] == trace.cells
        assert [record.captured for record in records] == trace.captured
        assert records[-1].move == LAND
        landing = Landing.model_validate_json(storage.read(PATHS.landing(1, f"agent-{index + 1}")))
        assert landing.metrics.captures == len(trace.own)
        assert landing.metrics.groups == landing.metrics.groups_explored == 1
        counts = trace.odometer.counts
        assert (landing.metrics.steps, sum(record.legal != 0 for record in records)) == (counts.steps, counts.decisions)
    claims = sorted(
        (record.time_s, index, record.claimed, record.predictions)
        for index in range(agents)
        for record in log_of(storage, f"agent-{index + 1}")
        if record.claimed is not None
    )
    assert [(t, c, p) for t, _, c, p in claims] == [(c.time_s, c.accuracy, c.predictions) for c in swarm.claims]


def test_it_does_not_matter_how_fast_each_agent_is(tmp_path: Path) -> None:
    """Each agent is held up at random, differently in each run."""
    logs = []
    for run in range(3):
        storage, generator = prepared(tmp_path / str(run), 3), random.Random(run)
        fly(storage, step=lambda *_, g=generator: time.sleep(g.choice([0.0, 0.0, 0.0, 0.01])))  # type: ignore[misc]
        logs.append([storage.read(PATHS.log(1, f"agent-{index}")) for index in (1, 2, 3)])
    assert logs[0] == logs[1] == logs[2]


def test_a_workflow_that_is_killed_goes_on_as_if_nothing_had_happened(tmp_path: Path) -> None:
    """One agent dies again and again; the others wait for it."""
    undisturbed = prepared(tmp_path / "undisturbed", 3)
    fly(undisturbed)
    storage = prepared(tmp_path / "killed", 3)

    class Killed(Exception):
        pass

    def die(_: Pilot, record: Record) -> None:
        if record.step in {0, 1, 2, 4, 7}:
            raise Killed

    others = threading.Thread(target=fly, args=(storage, ["agent-1", "agent-3"]))
    others.start()
    deaths = 0
    while not storage.exists(PATHS.landing(1, "agent-2")):
        try:
            fly_one(storage, "agent-2", die)
        except Killed:
            deaths += 1
    others.join(60)
    assert deaths == 5
    for agent in ("agent-1", "agent-2", "agent-3"):
        assert log_of(storage, agent) == log_of(undisturbed, agent)


def test_the_others_fly_on_without_an_agent_that_has_failed(tmp_path: Path) -> None:
    storage = prepared(tmp_path, 3)
    broken = Landing(agent="agent-2", failed=True, message="the vehicle is lost", metrics=AgentMetrics("agent-2"))
    put(storage, PATHS.landing(1, "agent-2"), broken)
    fly(storage, ["agent-1", "agent-3"])
    for agent in ("agent-1", "agent-3"):
        records = log_of(storage, agent)
        assert records[-1].move == LAND
        assert {record.heard[1] for record in records if record.heard} == {0}


@pytest.mark.parametrize("steps", [1, 2, 4, 7, 11])
def test_an_agent_that_lives_again_flies_the_same_when_another_has_failed_on_the_way(
    tmp_path: Path, steps: int
) -> None:
    """What the failed agent wanted to capture is open again from the moment that it is overdue, also in a replay."""
    storage = prepared(tmp_path, 3)

    class Failed(Exception):
        pass

    def fail(_: Pilot, record: Record) -> None:
        if record.step + 1 == steps:
            raise Failed

    others = threading.Thread(target=fly, args=(storage, ["agent-1", "agent-3"]))
    others.start()
    with pytest.raises(Failed):
        fly_one(storage, "agent-2", fail)
    put(storage, PATHS.landing(1, "agent-2"), Landing(agent="agent-2", failed=True, metrics=AgentMetrics("agent-2")))
    others.join(60)
    for agent in ("agent-1", "agent-3"):
        records = log_of(storage, agent)
        assert records[-1].move == LAND
        pilot = Pilot(settings_of(storage, agent), PLACE)
        pilot.replay(records)
        assert pilot.landed


def test_a_field_is_not_said_to_be_captured_because_a_failed_agent_stood_on_its_last_cell(tmp_path: Path) -> None:
    truth = drawn(4, 6, 6)
    storage = prepared(tmp_path, 2, truth, goals=[{"metric": "accuracy", "atLeast": 0.99}])
    put(storage, PATHS.landing(1, "agent-2"), Landing(agent="agent-2", failed=True, metrics=AgentMetrics("agent-2")))
    fly(storage, ["agent-1"])
    assert sum(record.captured for record in log_of(storage, "agent-1")) == truth.size


def test_agents_land_at_the_goal_that_the_fleetspec_has_now(tmp_path: Path) -> None:
    """The reward was shaped for another one."""
    flown = []
    for goal in (0.6, 0.95):
        storage = prepared(tmp_path / str(goal), 2, goals=[{"metric": "accuracy", "atLeast": goal}])
        fly(storage)
        flown.append(len(log_of(storage, "agent-1")))
    assert flown[0] < flown[1]


def test_a_landing_without_an_end_of_its_line_is_heard(tmp_path: Path) -> None:
    storage = prepared(tmp_path, 2)
    fly(storage)
    storage.write(PATHS.log(1, "agent-2"), storage.read(PATHS.log(1, "agent-2")).rstrip())
    listener = Hearing(settings_of(storage, "agent-1"), ManualClock())
    assert listener.until(1e9)[1][-1].move == LAND


def test_an_agent_that_is_silent_is_waited_for_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """agent-2 never says anything, and nobody says that it failed."""
    clock = ManualClock()
    monkeypatch.setattr(scout_mind, "SystemClock", lambda: clock)
    storage = prepared(tmp_path, 2)
    fly(storage, ["agent-1"])
    assert log_of(storage, "agent-1")[-1].move == LAND
    assert PATIENCE_S <= clock.now() < 1.1 * PATIENCE_S


def test_a_silent_agent_that_speaks_again_is_heard(tmp_path: Path) -> None:
    """It says something after the others have flown some way without it; a replay hears the same at each look."""
    storage = prepared(tmp_path, 2)
    alone = Hearing(settings_of(storage, "agent-1"), ManualClock(), patience_s=1.0)
    assert alone.until(100.0) == ((), ())
    fly_one_silently(storage)
    spoken = alone.until(100.0)[1]
    assert 0 < len(spoken) < len(log_of(storage, "agent-2"))
    assert all(record.time_s < 100.0 for record in spoken)
    assert alone.counts == (0, len(spoken))


def fly_one_silently(storage: LocalStorage) -> None:
    """agent-2 without hearing of agent-1, which is gone for it."""
    broken = Landing(agent="agent-1", failed=True, message="lost", metrics=AgentMetrics("agent-1"))
    put(storage, PATHS.landing(1, "agent-1"), broken)
    fly(storage, ["agent-2"])
    storage.delete(PATHS.landing(1, "agent-1"))


def test_what_is_heard_is_what_happened_before(tmp_path: Path) -> None:
    storage = prepared(tmp_path, 3)
    fly(storage)
    for index, agent in enumerate(("agent-1", "agent-2", "agent-3")):
        for record in log_of(storage, agent):
            if record.heard:
                for other, count in enumerate(record.heard):
                    before = [
                        each
                        for each in log_of(storage, f"agent-{other + 1}")
                        if (each.time_s, other) < (record.time_s, index)
                    ]
                    assert count == len(before)


def test_the_next_arrival_is_that_of_the_next_record(tmp_path: Path) -> None:
    storage = prepared(tmp_path, 2)
    fly(storage)
    energy = settings_of(storage, "agent-1").energy
    records = log_of(storage, "agent-1")
    assert [next_arrival_s(record, energy) for record in records[:-1]] == [record.time_s for record in records[1:]]
    assert next_arrival_s(records[-1], energy) == np.inf


@pytest.mark.parametrize("step", [15, 30])
def test_a_log_that_goes_on_with_that_of_another_field_is_refused(tmp_path: Path, step: int) -> None:
    storage, other = prepared(tmp_path / "one", 1), prepared(tmp_path / "other", 1, drawn(8, 14, 16))
    fly(storage)
    fly(other)
    mixed = [*log_of(storage, "agent-1")[:step], *log_of(other, "agent-1")[step:]]
    storage.write(PATHS.log(1, "agent-1"), b"".join(record.to_line() for record in mixed))
    storage.delete(PATHS.landing(1, "agent-1"))
    with pytest.raises(MissionError, match=r"start a new run|damaged, or of another run"):
        fly(storage)


def test_a_log_is_refused_whose_plans_were_made_with_more_than_there_is_to_hear(tmp_path: Path) -> None:
    storage = prepared(tmp_path, 2)
    fly(storage)
    whole = storage.read(PATHS.log(1, "agent-2")).splitlines(keepends=True)
    storage.write(PATHS.log(1, "agent-2"), b"".join(whole[: len(whole) // 2]))
    with pytest.raises(MissionError, match=r"a plan was made with \d+ records of agent-2, whose log has \d+"):
        fly_one(storage, "agent-1")


def test_a_torn_line_of_another_log_is_read_when_it_is_whole(tmp_path: Path) -> None:
    storage = prepared(tmp_path / "a", 2)
    fly(storage)
    data = storage.read(PATHS.log(1, "agent-2"))
    torn = prepared(tmp_path / "b", 2)
    listener = Hearing(settings_of(torn, "agent-1"), ManualClock(), patience_s=0.0)
    heard: list[Record] = []
    for end in range(0, len(data), 97):
        torn.write(PATHS.log(1, "agent-2"), data[:end])
        heard += listener.until(1e9)[1]
    torn.write(PATHS.log(1, "agent-2"), data)
    heard += listener.until(1e9)[1]
    assert tuple(heard) == log_of(storage, "agent-2")


def test_patience_is_longer_than_a_pod_takes_to_be_started_again() -> None:
    assert hearing.PATIENCE_S >= 60.0


def test_agents_take_off_in_the_middle_of_their_parts(tmp_path: Path) -> None:
    storage = prepared(tmp_path, 4, np.ones((8, 12)) * drawn(0, 8, 12))
    fly(storage)
    starts = {divmod(log_of(storage, f"agent-{index}")[0].cell, 12) for index in (1, 2, 3, 4)}
    grid = Grid(np.ones((8, 12), dtype=np.bool_), 10.0, 10.0)
    assert len(starts) == 4
    assert all(1 <= row < grid.rows - 1 and 1 <= column < grid.columns - 1 for row, column in starts)


def test_a_reward_is_for_agents_that_plan_or_for_agents_in_groups(tmp_path: Path) -> None:
    storage = prepared(tmp_path, 1)
    in_groups = REWARD.model_copy(update={"planner": None})
    assert in_groups.of_groups == in_groups
    with pytest.raises(TrainingError, match=r"shaped for a Planner, and sa\.kind is another; train again"):
        _ = REWARD.of_groups
    put(storage, PATHS.reward, in_groups)
    with pytest.raises(TrainingError, match=r"shaped for state groups, and sa\.kind is Planner; train again"):
        fly(storage)

"""What agents that plan claimed on the way, held against the simulator's own map at each of those moments."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.calibration import calibration_curve

from fleet.contexts.base import Environment
from fleet.functions.belief import Belief
from fleet.functions.classes import class_probabilities, classes, likely_values
from fleet.missions.records import Record, read_log
from fleet.planning.calibration import Calibration
from fleet.planning.stop import Claim
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import Tactics
from fleet.report.claims import BINS, LEAST, Reliability, mission_claims, reliability
from fleet.report.collect import AgentRun, MissionRun, RunData
from fleet.report.pictures import claims_pictures
from tests import planned_flights
from tests.flown_missions import fly_missions, settings_of
from tests.planned_flights import FEATURES, PATHS, WEIGHTS
from tests.planning import ENERGY, Values, drawn, environment

FIELD = drawn(2, 11, 12)
PNG = b"\x89PNG\r\n\x1a\n"
PLANNER = planned_flights.REWARD.of_planner.model_copy(update={"goal": 0.85})
REWARD = planned_flights.REWARD.model_copy(update={"planner": PLANNER})


class Recorded(Swarm):
    """A simulated mission that leaves logs, and says how good its map was at each look.

    Args:
        truth: The field.
        agents: How many.
    """

    def __init__(self, truth: Values, agents: int) -> None:
        grid = environment(truth).grid
        super().__init__(Belief(grid), ENERGY, scattered(grid, agents, 4), Tactics(weights=WEIGHTS), PLANNER.rule)
        self.truth, self.mean = truth, float(np.nanmean(truth))
        self.true: list[float] = []
        self.logs: list[list[Record]] = [[] for _ in range(agents)]
        self.fly(truth.item, self.watch)
        for index, trace in enumerate(self.traces):
            assert [record.cell for record in self.logs[index]] == trace.cells[: len(self.logs[index])]

    def watch(self) -> bool:
        """The accuracy of the map just after a claim, which is that of the last agent to arrive."""
        found = classes(likely_values(self.belief.prediction(), self.mean), self.mean)
        self.true.append(float((found == classes(self.truth, self.mean))[self.grid.valid].mean()))
        return False

    def is_due(self, scout: object) -> bool:
        """Called once in each state, after its capture: here its record is begun."""
        index = next(number for number, one in enumerate(self.scouts) if one is scout)
        trace, due = self.traces[index], super().is_due(self.scouts[index])
        cell, captured = trace.cells[-1], trace.captured[-1]
        time_s = trace.odometer.time_s - (ENERGY.capture().time_s if captured else 0.0)
        row, column = self.grid.position(cell)
        ssv = (0.5, float(self.truth.flat[cell])) if captured else ()
        self.logs[index].append(Record(len(self.logs[index]), cell, row, column, captured, ssv, 0, 0, "", time_s, 0.0))
        return due

    def look(self, scout: object, time_s: float) -> object:  # type: ignore[override]  # plain types suffice here
        index = next(number for number, one in enumerate(self.scouts) if one is scout)
        ending = super().look(self.scouts[index], time_s)
        claim: Claim = self.claims[-1]
        told = {"claimed": claim.accuracy, "predictions": claim.predictions, "time_s": time_s}
        self.logs[index][-1] = replace(self.logs[index][-1], **told)  # type: ignore[arg-type]  # fields by name
        return ending

    def run_over(self, place: Environment) -> MissionRun:
        runs = [AgentRun(f"agent-{index + 1}", tuple(log), None) for index, log in enumerate(self.logs)]
        return MissionRun(1, "field", place, agents=tuple(runs))


@cache
def recorded(agents: int = 3, holes: bool = False) -> Recorded:
    truth = FIELD.copy()
    if holes:
        truth[3:6, 4:6] = np.nan
    return Recorded(truth, agents)


@pytest.mark.parametrize("agents", [1, 3, 11])
@pytest.mark.parametrize("holes", [False, True])
def test_what_is_told_of_a_claim_is_what_was_true_at_that_moment(agents: int, holes: bool) -> None:
    swarm = recorded(agents, holes)
    found = mission_claims(swarm.run_over(environment(swarm.truth)), PLANNER, FEATURES)
    assert found is not None
    claims = found.claims
    assert claims.time_s.tolist() == [claim.time_s for claim in swarm.claims]
    assert claims.claimed.tolist() == [claim.accuracy for claim in swarm.claims]
    assert claims.true.tolist() == swarm.true
    assert claims.goal == PLANNER.goal
    needed = [PLANNER.goal + 0.01 + PLANNER.caution / n**0.5 if (n := c.predictions) else np.nan for c in swarm.claims]
    assert claims.needed == pytest.approx(needed, nan_ok=True)
    assert np.isnan(claims.needed[0])
    assert claims.claimed[-1] > claims.claimed[0]


def test_predictions_are_told_as_the_agents_corrected_them_in_the_end() -> None:
    swarm = recorded()
    found = mission_claims(swarm.run_over(environment(swarm.truth)), PLANNER, FEATURES)
    assert found is not None
    calibration: Calibration = swarm.calibration
    said = np.array([one for one, _ in calibration.pairs])
    right = np.array([was for _, was in calibration.pairs])
    assert_equal(found.captured, reliability(said, right))
    assert_equal(found.calibrated, reliability(calibration.calibrated(said), right))
    assert found.captured.count.sum() > 30
    assert found.unseen is not None
    probable = class_probabilities(swarm.belief.prediction(), swarm.mean).max(axis=0)[swarm.belief.free]
    believed = classes(likely_values(swarm.belief.prediction(), swarm.mean), swarm.mean)
    was_right = (believed == classes(swarm.truth, swarm.mean))[swarm.belief.free]
    assert_equal(found.unseen, reliability(calibration.calibrated(probable), was_right))


def assert_equal(one: Reliability, other: Reliability) -> None:
    for name in ("probability", "right", "count"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-9)


def test_without_the_truth_nothing_is_true_and_nothing_is_said_of_unseen_cells() -> None:
    swarm = recorded()
    place = environment(swarm.truth)
    unknown = Environment(place.name, "", place.grid)
    found = mission_claims(swarm.run_over(unknown), PLANNER, FEATURES)
    known = mission_claims(swarm.run_over(place), PLANNER, FEATURES)
    assert found is not None
    assert known is not None
    assert np.isnan(found.claims.true).all()
    assert found.unseen is None
    assert found.claims.claimed.tolist() == known.claims.claimed.tolist()
    assert_equal(found.calibrated, known.calibrated)


def test_a_mission_of_an_unknown_place_or_one_through_state_groups_claims_nothing(
    tmp_path: Path, quick_disk: None
) -> None:
    swarm = recorded()
    place = environment(swarm.truth)
    assert mission_claims(replace(swarm.run_over(place), environment=None), PLANNER, FEATURES) is None
    assert mission_claims(MissionRun(1, "field", place), PLANNER, FEATURES) is None
    storage = fly_missions(tmp_path, missions=1)
    settings = [settings_of(storage, agent, 1) for agent in ("agent-1", "agent-2")]
    grouped = tuple(
        AgentRun(one.agent, read_log(one.storage.read(one.paths.log(1, one.agent))), None) for one in settings
    )
    assert all(run.records for run in grouped)
    assert mission_claims(MissionRun(1, "field", place, agents=grouped), PLANNER, FEATURES) is None


# reliability

predictions = st.lists(st.tuples(st.floats(0, 1), st.booleans()), max_size=200)


def plainly(said: list[float], right: list[bool]) -> list[tuple[float, float, int]]:
    """Bin by bin; a bin begins with its lower bound, and the last one has its upper bound too."""
    rows = []
    for low, high in pairwise(BINS):
        own = [
            (probability, was)
            for probability, was in zip(said, right, strict=True)
            if low <= probability < high or probability == high == BINS[-1]
        ]
        if len(own) >= LEAST:
            rows.append((sum(p for p, _ in own) / len(own), sum(was for _, was in own) / len(own), len(own)))
    return rows


@given(predictions)
def test_predictions_are_told_by_their_probability_and_few_of_them_not_at_all(pairs: list[tuple[float, bool]]) -> None:
    said, right = [one for one, _ in pairs], [was for _, was in pairs]
    found = reliability(np.array(said, dtype=np.float64), np.array(right, dtype=np.bool_))
    rows = list(zip(found.probability, found.right, found.count, strict=True))
    assert rows == [pytest.approx(row) for row in plainly(said, right)]


def test_it_is_the_calibration_curve_of_scikit_learn() -> None:
    generator = np.random.default_rng(3)
    said = generator.uniform(0.1, 1.0, 3000).round(3) + 1e-6
    right = generator.uniform(size=3000) < said**2
    found = reliability(said, right)
    in_tenths = said >= 0.4  # the first bin here is wider than theirs
    shares, probabilities = calibration_curve(right[in_tenths], said[in_tenths].clip(max=1.0), n_bins=10)
    assert found.right[1:] == pytest.approx(shares)
    assert found.probability[1:] == pytest.approx(probabilities, abs=1e-6)
    assert found.count.sum() == 3000


# pictures


def pictures_of(swarm: Recorded, **changes: object) -> dict[str, bytes]:
    mission = swarm.run_over(environment(swarm.truth))
    run = RunData(PATHS, reward=REWARD.model_copy(update=changes), missions=(mission,))
    return {picture.path: picture.png for picture in claims_pictures(run, mission)}


def test_claims_are_drawn_and_other_claims_otherwise() -> None:
    found, again, other = pictures_of(recorded()), pictures_of(recorded()), pictures_of(recorded(holes=True))
    assert list(found) == ["missions/0001/accuracy.png", "missions/0001/calibration.png"]
    assert all(png.startswith(PNG) for png in found.values())
    assert found == again
    assert all(found[path] != other[path] for path in found)
    stricter = pictures_of(recorded(), planner=PLANNER.model_copy(update={"caution": 2.0}))
    assert stricter["missions/0001/accuracy.png"] != found["missions/0001/accuracy.png"]
    assert stricter["missions/0001/calibration.png"] == found["missions/0001/calibration.png"]


def test_where_nobody_planned_no_claims_are_drawn() -> None:
    assert pictures_of(recorded(), planner=None) == {}
    place = environment(FIELD)
    assert claims_pictures(RunData(PATHS, reward=REWARD), MissionRun(1, "field", place)) == ()
    assert claims_pictures(RunData(PATHS), recorded().run_over(place)) == ()

"""What agents that plan claimed of their map on the way, and how far that was true.

Everything is told anew from the logs: the captures of all agents, in the order of mission time and of equal times in
that of the agents, make the belief that the agents had, up to what one of them had not heard yet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Environment
from fleet.functions.belief import Belief
from fleet.functions.classes import class_mean, classes, likely_values
from fleet.learning.reward import PlannerReward
from fleet.missions.records import Record
from fleet.planning.calibration import Calibration
from fleet.report.collect import MissionRun

Values = NDArray[np.float64]
Moment = tuple[float, int]
"""Mission time in s, and the index of the agent that does something then: who hears of what."""
BINS = (0.0, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Bounds of the probabilities that are shown together."""
LEAST = 5
"""Fewer predictions than this say nothing."""


@dataclass(frozen=True, eq=False)
class Claims:
    """Expected accuracy along a mission.

    Args:
        time_s: Mission time of each claim, float64 [n].
        claimed: Expected accuracy, float64 [n].
        needed: Expected accuracy with which the agents land, float64 [n]; NaN where they could not.
        true: Accuracy of the map at that moment, float64 [n]; NaN where the truth is not known.
        goal: Accuracy that the mission must reach.
    """

    time_s: Values
    claimed: Values
    needed: Values
    true: Values
    goal: float


@dataclass(frozen=True, eq=False)
class Reliability:
    """How often classes were right that were given some probability.

    Args:
        probability: Mean of the probabilities in each bin, float64 [n].
        right: Share of the predictions in it that were right, float64 [n].
        count: How many there were, int64 [n].
    """

    probability: Values
    right: Values
    count: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class MissionClaims:
    """What a mission says of its agents' claims.

    Args:
        claims: On the way.
        captured: Predictions that were held against the next captures, as the agents did.
        calibrated: The same, as the agents corrected them in the end.
        unseen: What was believed in the end of cells that nobody captured, held against the truth; None without it.
    """

    claims: Claims
    captured: Reliability
    calibrated: Reliability
    unseen: Reliability | None


def mission_claims(mission: MissionRun, planner: PlannerReward, features: Sequence[str]) -> MissionClaims | None:
    """What the agents of a mission claimed; None when none of them planned, or its place is not known."""
    environment = mission.environment
    looks = [(moment, record) for moment, record in _in_order(mission) if record.claimed is not None]
    if environment is None or not looks:
        return None
    told = _Told(environment, mission, features.index(planner.feature))
    true = [told.accuracy_at(moment) for moment, _ in looks]
    told.accuracy_at((inf, 0))
    rule = planner.rule
    claims = Claims(
        time_s=np.array([time_s for (time_s, _), _ in looks]),
        claimed=np.array([record.claimed for _, record in looks], dtype=np.float64),
        needed=np.array([rule.needed(r.predictions) if r.predictions else np.nan for _, r in looks]),
        true=np.array(true),
        goal=planner.goal,
    )
    calibration = told.calibration
    said = np.array([probability for probability, _ in calibration.pairs], dtype=np.float64)
    right = np.array([was_right for _, was_right in calibration.pairs], dtype=np.bool_)
    return MissionClaims(
        claims,
        reliability(said, right),
        reliability(calibration.calibrated(said), right),
        _unseen(told),
    )


def reliability(said: Values, right: NDArray[np.bool_]) -> Reliability:
    """Predictions by their probability; bins with fewer than LEAST of them are left out.

    Args:
        said: Probabilities, float64 [n].
        right: Whether each was right, bool [n].
    """
    of = np.clip(np.digitize(said, BINS) - 1, 0, len(BINS) - 2)
    counts = np.bincount(of, minlength=len(BINS) - 1)
    kept = [index for index, count in enumerate(counts) if count >= LEAST]
    return Reliability(
        probability=np.array([said[of == index].mean() for index in kept]),
        right=np.array([right[of == index].mean() for index in kept]),
        count=counts[kept].astype(np.int64),
    )


def _in_order(mission: MissionRun) -> list[tuple[Moment, Record]]:
    """All states of a mission in the order in which the agents hear of each other."""
    states = [((record.time_s, index), record) for index, run in enumerate(mission.agents) for record in run.records]
    return sorted(states, key=lambda state: state[0])


def _unseen(told: _Told) -> Reliability | None:
    """Predictions of the cells that nobody captured."""
    if told.true is None:
        return None
    belief = told.belief
    known = belief.free & np.isfinite(told.true)
    probable = belief.class_probabilities(told.mean).max(axis=0)[known]
    return reliability(told.calibration.calibrated(probable), (told.map() == told.true)[known])


class _Told:
    """The captures of a mission, told again in the order of time."""

    def __init__(self, environment: Environment, mission: MissionRun, column: int) -> None:
        self.belief, self.calibration = Belief.over(environment), Calibration()
        self.true, self.mean = None, 0.0
        if environment.truth is not None:
            self.mean = class_mean(environment.truth, environment)
            self.true = classes(np.where(environment.grid.valid, environment.truth, np.nan), self.mean)
        self._column = column
        self._left = [(moment, record) for moment, record in _in_order(mission) if record.captured][::-1]

    def accuracy_at(self, moment: Moment) -> float:
        """Take in what was captured up to a moment; the accuracy of the map then, NaN when the truth is not known."""
        while self._left and self._left[-1][0] <= moment:
            record = self._left.pop()[1]
            value = record.ssv[self._column]
            if self.belief.free.flat[record.cell]:
                self.calibration.foresee(self.belief, record.cell, value)
                self.belief.observe([record.cell], [value])
        if self.true is None or not self.belief.captured:
            return float("nan")
        return float((self.map() == self.true)[np.isfinite(self.true)].mean())

    def map(self) -> Values:
        """The most probable class of each cell, float64 [rows, columns]; classes refer to the true mean."""
        return classes(likely_values(self.belief.prediction(), self.mean), self.mean)

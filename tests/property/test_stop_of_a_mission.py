"""When a swarm may land, and what missions over contexts teach of that."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.planning.stop import MARGIN, Claims, StopRule, learned

share = st.floats(0.0, 1.0)


@st.composite
def missions(draw: st.DrawFn) -> list[Claims]:
    """Missions that get better and claim so, more or less truly."""
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    found = []
    for _ in range(draw(st.integers(1, 12))):
        claims = draw(st.integers(1, 40))
        truth = np.minimum(np.linspace(generator.uniform(0.3, 0.8), generator.uniform(0.9, 1.1), claims), 1.0)
        claimed = np.clip(truth + generator.normal(0.0, draw(st.sampled_from([0.0, 0.02, 0.1])), claims), 0.0, 1.0)
        found.append(Claims(claimed, truth, np.arange(claims, dtype=np.int64) * 16, np.arange(claims) * 9.0))
    return found


def lands_at(mission: Claims, goal: float, caution: float) -> int:
    """Index of the first claim that is good enough, or of the last one."""
    for index, (claimed, predictions) in enumerate(zip(mission.claimed, mission.predictions, strict=True)):
        if predictions > 0 and claimed - MARGIN - caution / math.sqrt(predictions) >= goal:
            return index
    return len(mission.claimed) - 1


def naively_learned(flown: list[Claims], goal: float, confidence: float) -> float:
    """The first of the cautions 0, 0.05, .., 3 that is enough."""
    for step in range(61):
        caution = round(0.05 * step, 2)
        met = sum(bool(mission.truth[lands_at(mission, goal, caution)] >= goal) for mission in flown)
        if met / len(flown) >= confidence:
            return caution
    return 3.0


@given(share, share, st.integers(0, 5000), st.floats(0.0, 3.0))
def test_a_mission_ends_when_its_claim_is_beyond_the_goal_by_the_margin_and_the_caution(
    goal: float, claimed: float, predictions: int, caution: float
) -> None:
    enough = predictions > 0 and claimed >= goal + MARGIN + caution / math.sqrt(max(predictions, 1))
    assert StopRule(goal, caution).is_met(claimed, predictions) == enough or claimed == pytest.approx(
        goal + MARGIN + caution / math.sqrt(max(predictions, 1)), abs=1e-12
    )


@pytest.mark.parametrize(
    ("claimed", "predictions", "met"),
    [(0.97, 100, True), (0.95, 100, False), (0.97, 64, False), (1.0, 0, False), (1.0, 1, False), (0.97, 400, True)],
)
def test_fewer_predictions_need_a_higher_claim(claimed: float, predictions: int, met: bool) -> None:
    assert StopRule(0.9, 0.5).is_met(claimed, predictions) == met


@given(missions(), st.floats(0.5, 1.0), st.floats(0.0, 3.0))
def test_a_mission_ends_at_its_first_claim_that_is_enough(flown: list[Claims], goal: float, caution: float) -> None:
    for mission in flown:
        at = mission.stop(StopRule(goal, caution))
        assert (len(mission.claimed) - 1 if at is None else at) == lands_at(mission, goal, caution)


@given(missions(), st.sampled_from([0.7, 0.85, 0.95, 1.0]), st.sampled_from([0.0, 0.5, 0.8, 0.9, 1.0]))
def test_the_least_caution_is_learned_that_is_confident_enough(
    flown: list[Claims], goal: float, confidence: float
) -> None:
    rule = learned(flown, goal, confidence)
    assert rule.goal == goal
    assert rule.caution == pytest.approx(naively_learned(flown, goal, confidence), abs=1e-9)


@given(missions(), st.sampled_from([0.7, 0.85, 0.95]))
def test_more_confidence_never_means_less_caution(flown: list[Claims], goal: float) -> None:
    cautions = [learned(flown, goal, confidence).caution for confidence in (0.0, 0.25, 0.5, 0.75, 0.9, 1.0)]
    assert cautions == sorted(cautions)


def test_of_missions_that_never_meet_the_goal_the_greatest_caution_is_learned() -> None:
    boastful = Claims(np.array([0.9, 1.0]), np.array([0.5, 0.6]), np.array([100, 200]), np.array([1.0, 2.0]))
    assert learned([boastful], 0.8, 0.9) == StopRule(0.8, pytest.approx(3.0))


def test_of_honest_missions_no_caution_is_learned() -> None:
    honest = Claims(np.array([0.7, 0.95]), np.array([0.7, 0.95]), np.array([100, 200]), np.array([1.0, 2.0]))
    assert learned([honest], 0.8, 0.9) == StopRule(0.8, 0.0)


def test_without_missions_the_rule_is_the_default() -> None:
    assert learned([], 0.8, 0.9) == StopRule(0.8) == StopRule(0.8, 1.0)

from __future__ import annotations

import numpy as np
import pytest

from fleet.aggregation.retrain import retrain
from fleet.aggregation.subsets import Subset
from fleet.errors import MissionError
from fleet.learning.experience import concatenate, from_log
from fleet.learning.model import Fit
from fleet.learning.models import blank_model
from fleet.learning.reward import Normaliser, RewardModel
from fleet.missions.records import Record
from fleet.spec.learning import Retraining, SASpec

NORMALISER = Normaliser(low=(0.0, 0.0), high=(1.0, 1.0))
REWARD = RewardModel(
    features=("green", "bright"), weights=(1.0, 0.5), normaliser=NORMALISER, utility_threshold=9.0,
    visited_threshold=9, loss=0.0, goals_met=True,
)  # fmt: skip
SUBSET = Subset(("agent-1", "agent-3"), "1-3")
BLANK = blank_model(SASpec(), REWARD.features, NORMALISER, seed=1)
RETRAINING = Retraining(epochs=3, learning_rate=0.5)


def log(seed: int, steps: int = 20) -> tuple[Record, ...]:
    """A flight along a row, in which SA was asked in every state but the last."""
    ssvs = np.random.default_rng(seed).random((steps, 2)).tolist()
    last = steps - 1
    return tuple(
        Record(i, i, 0, i, True, tuple(ssvs[i]), 0b100 if i < last else 0, 2 if i < last else -1, "East", 0.0, 0.0)
        for i in range(steps)
    )


LOGS = {"agent-1": log(1), "agent-2": log(2), "agent-3": log(3)}


def test_a_subset_learns_from_the_records_of_its_agents_alone() -> None:
    model, transitions = retrain(BLANK, LOGS, SUBSET, REWARD, RETRAINING, seed=5)
    own = concatenate([from_log(LOGS["agent-1"], REWARD), from_log(LOGS["agent-3"], REWARD)])
    expected = BLANK.updated(own, Fit(epochs=3, learning_rate=0.5, seed=5))
    assert (model.to_bytes(), transitions) == (expected.to_bytes(), len(own))
    assert transitions == 38
    without = {**LOGS, "agent-2": ()}
    assert retrain(BLANK, without, SUBSET, REWARD, RETRAINING, seed=5)[0].to_bytes() == model.to_bytes()


def test_retraining_goes_on_from_the_given_model_and_does_not_change_it() -> None:
    before = BLANK.to_bytes()
    once, _ = retrain(BLANK, LOGS, SUBSET, REWARD, RETRAINING, seed=5)
    twice, _ = retrain(once, LOGS, SUBSET, REWARD, RETRAINING, seed=5)
    assert BLANK.to_bytes() == before
    assert len({BLANK.to_bytes(), once.to_bytes(), twice.to_bytes()}) == 3


def test_the_same_seed_gives_the_same_model() -> None:
    models = [retrain(BLANK, LOGS, SUBSET, REWARD, RETRAINING, seed)[0].to_bytes() for seed in (5, 5, 6)]
    assert models[0] == models[1] != models[2]


def test_nothing_is_learned_from_empty_logs() -> None:
    empty = {"agent-1": (), "agent-3": log(1, steps=1)}
    assert retrain(BLANK, empty, SUBSET, REWARD, RETRAINING, seed=5) == (BLANK, 0)


def test_a_log_that_was_not_given_is_an_error() -> None:
    with pytest.raises(MissionError, match="subset 1-3 has no log of agent-3"):
        retrain(BLANK, {"agent-1": ()}, SUBSET, REWARD, RETRAINING, seed=5)

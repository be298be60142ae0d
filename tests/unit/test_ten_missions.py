"""Ten successive missions of the default learner over a planted field that drifts, with two subsets that mislead."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from bench import weights
from bench.missions import FEATURES, Field, World, alone, field_of, objective, trained
from bench.weights import Arm, Campaign, campaign, drifting
from fleet.aggregation.subsets import Subset
from fleet.learning.model import SAModel
from fleet.learning.reward import Normaliser, RewardModel
from fleet.missions.documents import INITIAL
from fleet.spec.learning import OnlineLearning

MISSIONS, SEEDS = 10, 6
FAIR = 1.0 / 16.0
"""Share of each model if the agents had no reason to prefer one."""
USELESS, HARMFUL = "3", "4"
"""Subsets of one agent each: the model of one never learns, that of the other flees from what is rich."""


@dataclass(frozen=True)
class Planted(Arm):
    """Aggregators of the two planted subsets make nothing of what is recorded."""

    def retrained(self, useful: Sequence[Mapping[str, float | None]]) -> list[Subset]:
        return [subset for subset in super().retrained(useful) if subset.key not in (USELESS, HARMFUL)]


def rich_rows(seed: int) -> Field:
    """Every fourth row is rich, and the third feature says which: who follows it meets T_u with few moves."""
    generator = np.random.default_rng(seed)
    row = np.arange(36)[:, None] % 4
    truth = 100.0 + 30.0 * (row == 1) + 3.0 * generator.normal(size=(36, 30))
    follows = 0.01 * truth + 0.02 * generator.normal(size=truth.shape)
    return field_of(f"rows-{seed}", np.stack([truth, follows, row + np.zeros_like(truth)], axis=2))


def fields(seed: int) -> tuple[list[World], dict[str, SAModel]]:
    """The field of each mission, and the models before the first; SA was trained on another year's field."""
    here, before = rich_rows(seed), rich_rows(seed + 500)
    reward = RewardModel(
        features=FEATURES,
        weights=(1.0, 0.0, 0.0),
        normaliser=Normaliser.over([before.ssv]),
        utility_threshold=2.4,
        visited_threshold=9,
        loss=0.0,
        goals_met=True,
    )
    first = trained(before, reward, seed)
    world = World(here, reward, objective(0.0))
    world = replace(world, objective=objective(alone(world, first).accuracy - 0.1))
    models = {
        INITIAL: first,
        USELESS: replace(first, weights=np.zeros_like(first.weights)),
        HARMFUL: replace(first, weights=-first.weights),
    }
    return list(drifting([world], MISSIONS, seed)), models


@pytest.fixture(scope="module")
def flown() -> Iterator[list[tuple[Campaign, Campaign]]]:
    """By seed the campaign of the default learner, and that of the first model alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(weights, "USELESS", USELESS)
        patch.setattr(weights, "HARMFUL", HARMFUL)
        found = []
        for seed in range(SEEDS):
            worlds, models = fields(seed)
            arms = (Planted(OnlineLearning().weights), Arm(None))
            found.append(tuple(campaign(worlds, models, arm, seed) for arm in arms))
        yield found


def test_the_planted_models_are_worse_than_the_first_one() -> None:
    worlds, models = fields(0)
    losses = {key: alone(worlds[0], model).smooth for key, model in models.items()}
    assert losses[INITIAL] + 0.03 < losses[USELESS]
    assert losses[INITIAL] + 0.03 < losses[HARMFUL]


@pytest.mark.parametrize("planted", [USELESS, HARMFUL])
def test_a_useless_and_a_harmful_subset_lose_their_usefulness(
    flown: list[tuple[Campaign, Campaign]], planted: str
) -> None:
    given = np.mean([learned.given[planted] for learned, _ in flown], axis=0)
    assert given.max() > FAIR / 4, "they had some"
    assert given[-3:].mean() < FAIR / 4


def test_weights_concentrate_on_models_that_help(flown: list[tuple[Campaign, Campaign]]) -> None:
    assert np.mean([learned.largest[-3:] for learned, _ in flown]) > 4 * FAIR


def test_goals_come_nearer_from_mission_to_mission_than_they_would_with_the_first_model(
    flown: list[tuple[Campaign, Campaign]],
) -> None:
    won = np.array([np.subtract(first.losses, learned.losses) for learned, first in flown]).mean(axis=0)
    assert won[0] == 0.0
    assert won[-3:].mean() > won[1:4].mean() + 0.005
    assert np.polyfit(range(MISSIONS), won, 1)[0] > 0.0

"""The campaigns that learners of weights are compared by."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.missions import World, alone, objective, trained, world_of
from bench.replays import HARMFUL, USELESS, subsets
from bench.weights import BEST, HEDGE, PRUNING, Arm, campaign, drifting, planted
from fleet.learning.model import SAModel
from fleet.missions.documents import INITIAL
from fleet.spec.learning import WeightLearner
from fleet.spec.platform import UsefulnessScale

MISSIONS = 6
FAIR = 1.0 / 18.0
"""Share of each model if the agents had no reason to prefer one."""


def field(seed: int) -> tuple[list[World], dict[str, SAModel]]:
    world, known = world_of("synthetic", seed, Path())
    first: dict[str, SAModel] = {INITIAL: trained(known.field, world.reward, seed)}
    world = replace(world, objective=objective(alone(world, first[INITIAL]).accuracy - 0.1))
    worlds = list(drifting([world], MISSIONS, seed))
    return worlds, first | planted(worlds, seed)


@pytest.mark.parametrize("learner", [HEDGE, BEST])
def test_a_harmful_model_loses_its_usefulness_and_on_most_fields_a_useless_one_does(learner: WeightLearner) -> None:
    flown = [campaign(*field(seed), Arm(learner), seed) for seed in range(5)]
    late = {key: [float(np.mean(each.given[key][2:])) for each in flown] for key in (USELESS, HARMFUL)}
    assert np.mean(late[HARMFUL]) < FAIR / 2
    assert np.median(late[HARMFUL]) < FAIR / 4
    assert np.median(late[USELESS]) < FAIR / 4


def test_the_planted_models_lose_more_than_the_first_one() -> None:
    worlds, models = field(1)
    losses = {key: sum(alone(world, model).smooth for world in worlds) for key, model in models.items()}
    assert losses[INITIAL] < losses[USELESS] < losses[HARMFUL]


def test_pruned_models_are_not_retrained_and_the_others_are() -> None:
    worlds, models = field(2)
    whole, pruned = (campaign(worlds, models, arm, 2) for arm in (Arm(HEDGE), Arm(HEDGE, PRUNING)))
    assert whole.retrained == [15] * MISSIONS
    assert pruned.retrained[:2] == [15, 15]
    assert pruned.retrained == sorted(pruned.retrained, reverse=True)
    assert pruned.retrained[-1] < 15


def test_a_field_drifts_further_with_every_mission_and_truth_with_what_is_seen() -> None:
    worlds, _ = field(3)
    first = worlds[0].field.environment.truth
    far = [float(np.nanstd(world.field.environment.truth - first)) for world in worlds]
    assert far[0] == 0.0
    assert (np.diff(far) > 0.0).all()
    last = worlds[-1].field
    drift = (last.environment.truth - first).ravel()
    seen = last.ssv[:, 0] - worlds[0].field.ssv[:, 0]
    both = np.isfinite(drift) & np.isfinite(seen)
    assert np.corrcoef(drift[both], seen[both])[0, 1] > 0.9


def test_models_of_level_0_are_suspended_and_those_that_never_flew_are_retrained() -> None:
    useful = {INITIAL: 0.5, "1": 0.04, "2": 0.06, "1-2": None, HARMFUL: 0.4}
    keys = [subset.key for subset in subsets()]
    absolute, relative = (Arm(HEDGE, scale=scale) for scale in UsefulnessScale)
    assert [subset.key for subset in absolute.retrained([])] == keys
    assert [subset.key for subset in absolute.retrained([useful])] == [key for key in keys if key != "1"]
    assert [subset.key for subset in relative.retrained([useful])] == keys
    assert "1" not in [subset.key for subset in relative.retrained([useful | {INITIAL: 0.9}])]


@pytest.mark.parametrize("scale", UsefulnessScale)
def test_with_levels_fewer_models_are_retrained_and_the_others_fly_as_they_were(scale: UsefulnessScale) -> None:
    worlds, models = field(2)
    flown = campaign(worlds, models, Arm(HEDGE, scale=scale), 2)
    assert flown.retrained[:1] == [15]
    assert min(flown.retrained) < 15
    assert len(flown.losses) == MISSIONS

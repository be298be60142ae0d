"""What a planned mission would have cost with other weights over its models, and what weights make of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from fleet.functions.belief import Belief
from fleet.functions.classes import classes, likely_values
from fleet.learning.goals import Objective
from fleet.learning.planner import PlannerModel
from fleet.missions.layout import Layout, plan_field
from fleet.planning.scouting import Scout
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import InterestWeights, Tactics
from fleet.spec.learning import OnlineLearning, WeightLearner
from fleet.spec.swarm import AgentSpec, Goal
from fleet.usefulness.history import History, Observation, Weights
from fleet.usefulness.loss import Effort, MissionLoss
from fleet.usefulness.planned_replay import LEVELS, REPLAYS, PlannedReplayer, believed
from fleet.usefulness.weights import first_weights, propose_weights
from tests.planning import ENERGY, Values, drawn, environment

AGENTS = ("agent-1", "agent-2")
WHOLE = Effort(0.4, 0.4)
MODELS = {
    "initial": PlannerModel.blank(("exg",), InterestWeights()),
    "1": PlannerModel.blank(("exg",), InterestWeights(doubt=1.0, doubt_around=0.5, novelty=0.3)),
    "harmful": PlannerModel.blank(("exg",), InterestWeights(doubt=0.0, doubt_around=0.0, novelty=1.0)),
}
"""The harmful one goes where nothing is known: on a banded field, where all is known by looking at a few cells."""


def banded(seed: int, rows: int = 9, columns: int = 12) -> Values:
    """Poor on one side and rich on the other, and in between a band of cells on the bounds of the classes."""
    truth = np.full((rows, columns), 40.0)
    truth[:, columns // 2 :] = 160.0
    band = slice(columns // 2 - 2, columns // 2 + 2)
    truth[:, band] = np.random.default_rng(seed).choice([75.0, 85.0, 95.0, 105.0], (rows, 4))
    return truth


def layout_over(truth: Values) -> Layout:
    return plan_field(environment(truth).grid, [AgentSpec(name=name) for name in AGENTS])


def mission_loss(accuracy: float) -> MissionLoss:
    objective = Objective((Goal(metric="accuracy", at_least=0.7),), "uav_energy_j")
    return MissionLoss(objective, {"accuracy": accuracy, "uav_energy_j": 1000.0}, WHOLE, 2000.0)


def replayer(truth: Values, flown: Mapping[str, Weights], accuracy: float = 0.8, share: float = 0.4) -> PlannedReplayer:
    return PlannedReplayer(
        layout=layout_over(truth),
        environment=environment(truth),
        agents=AGENTS,
        captured=int(share * np.isfinite(truth).sum()),
        flown=flown,
        before=MODELS,
        after=MODELS,
        energy=ENERGY,
        loss=mission_loss(accuracy),
    )


def alone(key: str) -> dict[str, float]:
    return {other: float(other == key) for other in MODELS}


ALIKE = dict.fromkeys(MODELS, 1 / len(MODELS))
BY_FIRST = {agent: alone("initial") for agent in AGENTS}


def with_holes() -> Values:
    truth = drawn(4, 9, 11)
    truth[2:5, 5:8] = np.nan
    return truth


@pytest.mark.parametrize("weights", [*(alone(key) for key in MODELS), ALIKE])
@pytest.mark.parametrize("truth", [banded(1), drawn(1), with_holes()], ids=["banded", "drawn", "holes"])
def test_the_weights_that_were_flown_have_the_loss_of_the_mission(truth: Values, weights: Weights) -> None:
    replay = replayer(truth, dict.fromkeys(AGENTS, weights))
    assert replay("agent-1", [weights]) == [replay.loss.of(WHOLE)]


def curve_of(truth: Values, weights: InterestWeights, number: int) -> list[tuple[float, float, int]]:
    """Accuracy of the map, energy and captured cells at each look of a mission over the whole field."""
    layout, curve, mean = layout_over(truth), list[tuple[float, float, int]](), float(np.nanmean(truth))
    scouts = scattered(layout.grid, 2, number) if number else [Scout(start) for start in layout.starts]
    swarm = Swarm(Belief(layout.grid), ENERGY, scouts, Tactics(weights=weights))

    def watch() -> bool:
        found = classes(likely_values(swarm.belief.prediction(), mean), mean)
        right = (found == classes(truth, mean))[np.isfinite(truth)]
        curve.append((float(right.mean()), swarm.spent_j, len(swarm.captured)))
        return False

    swarm.fly(truth.item, watch)
    return curve


def plain_ratio(truth: Values, flown: InterestWeights, tried: InterestWeights, share: float, number: int) -> float:
    """Energy to some accuracies over that of the last mission, from two whole flights."""
    last, other = curve_of(truth, flown, number), curve_of(truth, tried, number)
    end = next(index for index, (_, _, captured) in enumerate(last) if captured >= int(share * truth.size))
    ratios = []
    for part in range(LEVELS):
        at = round((end + 1) / 2 + (end - (end + 1) / 2) * part / (LEVELS - 1))
        accuracy = max(one for one, _, _ in last[: at + 1])
        energies = [next(energy for one, energy, _ in curve if one >= accuracy) for curve in (other, last)]
        ratios.append(energies[0] / energies[1])
    return sum(ratios) / LEVELS


@pytest.mark.parametrize("key", ["1", "harmful"])
@pytest.mark.parametrize("truth", [banded(1), drawn(1)], ids=["banded", "drawn"])
def test_a_replay_says_what_energy_equal_accuracies_take(truth: Values, key: str) -> None:
    flown, tried = MODELS["initial"].interest, MODELS[key].interest
    ratios = [plain_ratio(truth, flown, tried, 0.4, number) for number in range(REPLAYS)]
    replay = replayer(truth, BY_FIRST)
    (found,) = replay("agent-1", [alone(key)])
    assert len(set(ratios)) == REPLAYS
    assert found == pytest.approx(replay.loss.of(carried(sum(ratios) / REPLAYS)))
    means = [1.0, sum(ratios) / REPLAYS]
    middle, chance = sum(means) / 2, np.var(ratios, ddof=1) / REPLAYS / 2
    kept = max(0.0, 1.0 - chance / np.var(means, ddof=1))
    losses = [replay.loss.of(carried(middle + kept * (mean - middle))) for mean in means]
    assert replay("agent-1", [alone("initial"), alone(key)]) == pytest.approx(losses)


def carried(ratio: float) -> Effort:
    """Half of what is saved is energy, half of it goes into more captures."""
    return Effort(min(1.0, WHOLE.captured / ratio**0.5), WHOLE.energy * ratio**0.5)


@pytest.mark.parametrize("accuracy", [0.9, 0.71, 0.5])
def test_a_harmful_model_loses_more_whether_or_not_the_mission_met_its_goal(accuracy: float) -> None:
    replay = replayer(banded(1), BY_FIRST, accuracy)
    good, harmful = replay("agent-1", [alone("initial"), alone("harmful")])
    assert harmful > good + 0.03


def test_every_agent_is_told_the_same_and_the_same_again() -> None:
    candidates = [alone(key) for key in MODELS] + [ALIKE]
    replay, again = (replayer(banded(1), BY_FIRST) for _ in range(2))
    one, other = (replay(agent, candidates) for agent in AGENTS)
    assert one == other == again("agent-2", candidates)
    assert len(set(one)) >= 3


def test_agents_that_flew_with_weights_of_their_own_are_replayed_with_them() -> None:
    apart = {"agent-1": alone("initial"), "agent-2": alone("harmful")}
    losses = [replayer(banded(1), flown)("agent-1", [ALIKE]) for flown in (BY_FIRST, apart)]
    assert losses[0] != losses[1]


@pytest.mark.parametrize("share", [0.02, 1.0])
def test_a_mission_may_have_captured_hardly_anything_or_everything(share: float) -> None:
    replay = replayer(drawn(1), BY_FIRST, share=share)
    assert replay("agent-1", [alone("initial")]) == [replay.loss.of(WHOLE)]
    assert np.isfinite(replay("agent-1", [alone(key) for key in MODELS])).all()


# chance


def test_what_differs_by_chance_alone_does_not_differ() -> None:
    generator = np.random.default_rng(4)
    apart = [float(np.ptp(believed(1.0 + 0.1 * generator.normal(size=(8, REPLAYS))))) for _ in range(200)]
    assert np.mean(apart) < 0.02, "a tenth of what the means of four flights differ by"
    assert np.mean(np.array(apart) == 0.0) > 0.85
    alike = np.tile([0.9, 1.0, 1.1, 1.2], (3, 1))
    assert believed(alike).tolist() == [pytest.approx(1.05)] * 3


def test_what_differs_by_much_more_than_chance_is_believed_and_keeps_its_order() -> None:
    ratios = np.array([[1.0, 1.01, 0.99, 1.0], [1.5, 1.49, 1.5, 1.51], [2.0, 2.02, 1.98, 2.0]])
    assert believed(ratios) == pytest.approx([1.0, 1.5, 2.0], abs=0.001)
    noisy = believed(ratios + 0.4 * np.array([[1, -1, 1, -1], [-1, 1, 1, -1], [1, 1, -1, -1]]))
    assert 1.0 < noisy[0] < noisy[1] < noisy[2] < 2.0
    assert noisy.mean() == pytest.approx(1.5)


def test_one_candidate_is_believed_as_it_is() -> None:
    assert believed(np.array([[1.0, 2.0, 3.0, 4.0]])).tolist() == [2.5]


def learned(models: Mapping[str, PlannerModel], missions: int) -> dict[str, float]:
    """Mean weights after some missions over fields that change from one to the next."""
    weights, observations = first_weights(AGENTS), list[Observation]()
    learning = OnlineLearning(weights=WeightLearner.MULTIPLICATIVE_WEIGHTS)
    for number in range(1, missions + 1):
        replay = replayer(banded(number, 8, 10), weights)
        observations += [Observation(number, agent, weights[agent], replay.loss.of(WHOLE)) for agent in AGENTS]
        weights = propose_weights(History(tuple(observations)), list(models), AGENTS, learning, number, replay)
    return {key: sum(weights[agent][key] for agent in AGENTS) / len(AGENTS) for key in models}


def test_over_ten_missions_a_planted_harmful_model_loses_its_usefulness() -> None:
    after = learned(MODELS, missions=10)
    assert after["harmful"] < 0.03
    assert sum(after.values()) == pytest.approx(1.0)

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.spec.learning import OnlineLearning, WeightLearner
from fleet.usefulness.candidates import LARGEST_STEP, around, directions, replayed
from fleet.usefulness.experts import HORIZON, POOLED, best_alone, exponential_weights, pooled
from fleet.usefulness.history import History, Observation, Weights
from fleet.usefulness.weights import FIRST_STEP, first_weights, propose_weights, usefulness

AGENTS = ["agent-1", "agent-2"]
MODELS = ["initial", "1", "2", "1-2"]
WITHOUT = OnlineLearning(weights=WeightLearner.EXPECTED_IMPROVEMENT, replays=0)
WITH = OnlineLearning(weights=WeightLearner.EXPECTED_IMPROVEMENT, replays=8)
HEDGE = OnlineLearning(weights=WeightLearner.MULTIPLICATIVE_WEIGHTS)
BEST = OnlineLearning(weights=WeightLearner.BEST_BY_REPLAY)


def at(values: Sequence[float]) -> dict[str, float]:
    return dict(zip(MODELS, values, strict=True))


INITIAL = at([1.0, 0.0, 0.0, 0.0])
points = st.lists(st.integers(0, 10), min_size=4, max_size=4).filter(any).map(lambda n: at([x / sum(n) for x in n]))
histories = st.lists(st.tuples(points, st.floats(-1, 3)), max_size=5).map(
    lambda each: History(
        tuple(
            Observation(number, agent, weights, loss)
            for number, (weights, loss) in enumerate(each, 1)
            for agent in AGENTS
        )
    )
)


def flown(*losses: tuple[Weights, float]) -> History:
    return History(tuple(Observation(i, "agent-1", weights, loss) for i, (weights, loss) in enumerate(losses, 1)))


def distance(one: Weights, other: Weights) -> float:
    """Share of the weight that has moved."""
    return sum(abs(one.get(key, 0.0) - other.get(key, 0.0)) for key in MODELS) / 2


def green(agent: str, candidates: Sequence[Weights]) -> list[float]:
    """Replays that find model 2 good and model 1 bad."""
    return [0.5 + 0.3 * weights["1"] - 0.3 * weights["2"] for weights in candidates]


def test_every_agent_starts_with_the_model_of_the_first_training() -> None:
    assert first_weights(AGENTS) == {"agent-1": {"initial": 1.0}, "agent-2": {"initial": 1.0}}
    assert propose_weights(History(), MODELS, AGENTS, WITHOUT, seed=0) == dict.fromkeys(AGENTS, INITIAL)


def test_after_one_mission_the_weights_move_a_little_towards_all_models() -> None:
    found = propose_weights(flown((INITIAL, 0.5)), MODELS, ["agent-1"], WITHOUT, seed=0)
    share = FIRST_STEP / 4
    assert found == {"agent-1": at([1 - 3 * share, share, share, share])}


def test_uniform_weights_are_equal_whatever_happened() -> None:
    uniform = OnlineLearning(weights=WeightLearner.UNIFORM)
    found = propose_weights(flown((INITIAL, 0.5)), MODELS, AGENTS, uniform, seed=0, replay=green)
    assert found == dict.fromkeys(AGENTS, at([0.25] * 4))


def test_replays_lead_to_the_model_that_they_find_good() -> None:
    history = flown((INITIAL, 0.5))
    for _ in range(3):
        weights = propose_weights(history, MODELS, ["agent-1"], WITH, seed=3, replay=green)["agent-1"]
        loss = green("agent-1", [weights])[0]
        number = len(history.observations) + 1
        history = History((*history.observations, Observation(number, "agent-1", weights, loss)))
    assert weights["2"] > 0.7
    assert weights["1"] < 0.1


def test_a_mission_that_went_wrong_is_left_behind() -> None:
    bad = at([0.0, 1.0, 0.0, 0.0])
    found = propose_weights(flown((INITIAL, 0.5), (bad, 3.0)), MODELS, ["agent-1"], WITHOUT, seed=0)["agent-1"]
    assert distance(found, INITIAL) <= LARGEST_STEP + 1e-5


def test_agents_learn_from_their_own_missions() -> None:
    one, two = at([0.5, 0.5, 0.0, 0.0]), at([0.5, 0.0, 0.5, 0.0])
    first = flown((INITIAL, 0.9), (one, 0.2), (two, 0.9))
    second = tuple(Observation(each.mission, "agent-2", each.weights, 1.1 - each.loss) for each in first.observations)
    both = History((*second, *first.observations))
    found = propose_weights(both, MODELS, AGENTS, WITHOUT, seed=0)
    assert found["agent-1"] == propose_weights(first, MODELS, ["agent-1"], WITHOUT, seed=0)["agent-1"]
    assert found["agent-1"] != found["agent-2"]


def test_what_a_model_that_is_gone_had_is_shared_out() -> None:
    history = flown(({"initial": 0.5, "gone": 0.5}, 0.5))
    found = propose_weights(history, ["initial", "1"], ["agent-1"], WITHOUT, seed=0)
    assert found == {"agent-1": {"1": FIRST_STEP / 2, "initial": 1 - FIRST_STEP / 2}}
    only_gone = propose_weights(flown(({"gone": 1.0}, 0.5)), ["initial", "1"], ["agent-1"], WITHOUT, seed=0)
    assert only_gone == found


@settings(max_examples=25)
@given(histories, st.integers(0, 2**32), st.sampled_from([WITH, WITHOUT]))
def test_proposals_are_weights_near_the_best_that_was_flown_and_the_same_for_a_seed(
    history: History, seed: int, learning: OnlineLearning
) -> None:
    found = propose_weights(history, MODELS, AGENTS, learning, seed, green)
    assert found == propose_weights(history, list(reversed(MODELS)), AGENTS, learning, seed, green)
    for agent, weights in found.items():
        assert set(weights) == set(MODELS)
        assert all(0 <= weight <= 1 for weight in weights.values())
        assert sum(weights.values()) == pytest.approx(1.0, abs=1e-9)
        seen = history.of(agent)
        if seen:
            least = min(each.loss for each in seen)
            near = [each.weights for each in seen if each.loss == least] + [seen[-1].weights]
            assert min(distance(weights, each) for each in near) <= LARGEST_STEP + 1e-5


def test_one_model_gets_all_the_weight() -> None:
    history = flown(({"initial": 1.0}, 0.5), ({"initial": 1.0}, 0.4))
    assert propose_weights(history, ["initial"], ["agent-1"], WITH, 0, lambda a, c: [0.5] * len(c)) == {
        "agent-1": {"initial": 1.0}
    }


def test_usefulness_is_the_mean_weight_and_unknown_for_what_never_flew() -> None:
    weights = {"agent-1": {"initial": 0.5, "1": 0.5}, "agent-2": {"initial": 1.0, "1": 0.0, "2": 0.0}}
    assert usefulness(weights, MODELS) == {"initial": 0.75, "1": 0.25, "2": None, "1-2": None}
    assert usefulness(weights, MODELS, flown={"2"}) == {"initial": 0.75, "1": 0.25, "2": 0.0, "1-2": None}


def test_the_history_knows_what_has_flown() -> None:
    history = flown((INITIAL, 0.5), (at([0.5, 0.0, 0.5, 0.0]), 0.4))
    assert history.flown == {"initial", "2"}
    assert [each.mission for each in History(history.observations[::-1]).of("agent-1")] == [1, 2]
    assert history.of("agent-2") == ()


@given(st.integers(1, 20), st.integers(0, 2**32), st.integers(1, 40))
@settings(max_examples=30)
def test_candidates_and_replays_are_points_on_the_simplex(models: int, seed: int, count: int) -> None:
    best = np.full(models, 1.0 / models)
    last = np.eye(models)[0]
    replays = replayed(best, last, count, seed)
    candidates = around(best, directions(models, seed), LARGEST_STEP)
    for found in (replays, candidates):
        assert found.min() >= 0
        assert np.allclose(found.sum(axis=1), 1.0)
    assert len(replays) <= count
    assert len(np.unique(np.round(replays, 9), axis=0)) == len(replays)
    assert np.array_equal(replays[0], last)


def test_each_single_model_is_replayed_when_there_are_enough_replays() -> None:
    best = np.array([1.0, 0.0, 0.0])
    replays = replayed(best, best, 5, seed=1)
    for single in np.eye(3)[1:]:
        assert any(np.allclose(point, best + LARGEST_STEP * (single - best)) for point in replays)


# learners that look at each model alone


def lost(agent: str, candidates: Sequence[Weights]) -> list[float]:
    """Replays that find the model of both agents good, the useless one worse, and the harmful one worst."""
    noise = np.random.default_rng(len(candidates)).normal(size=4) * 0.02
    losses = at((np.array([0.50, 0.56, 0.80, 0.44]) + noise).tolist())
    return [sum(share * losses[key] for key, share in weights.items()) for weights in candidates]


@pytest.mark.parametrize("learning", [HEDGE, BEST])
def test_before_the_first_mission_nothing_is_known_of_the_models(learning: OnlineLearning) -> None:
    assert propose_weights(History(), MODELS, AGENTS, learning, seed=0) == dict.fromkeys(AGENTS, INITIAL)


@pytest.mark.parametrize("learning", [HEDGE, BEST])
def test_a_useless_and_a_harmful_model_lose_their_usefulness(learning: OnlineLearning) -> None:
    even = at([0.25] * 4)
    history = History(tuple(Observation(1, agent, even, 0.6) for agent in AGENTS))
    for number in range(2, 11):
        weights = propose_weights(history, MODELS, AGENTS, learning, seed=number, replay=lost)
        new = tuple(Observation(number, agent, weights[agent], lost(agent, [weights[agent]])[0]) for agent in AGENTS)
        history = History(history.observations + new)
    useful = usefulness(weights, MODELS)
    assert (useful["1"] or 0.0) < 0.05
    assert (useful["2"] or 0.0) < 0.01
    assert (useful["1-2"] or 0.0) > 0.8


@pytest.mark.parametrize("learning", [HEDGE, BEST])
def test_a_model_that_becomes_the_best_gets_the_weight(learning: OnlineLearning) -> None:
    def after_the_drift(agent: str, candidates: Sequence[Weights]) -> list[float]:
        return [0.5 - 0.1 * weights["1"] for weights in candidates]

    weights: dict[str, dict[str, float]] = dict.fromkeys(AGENTS, at([0.0, 0.0, 0.0, 1.0]))
    for number in range(1, 8):
        history = History(tuple(Observation(number, agent, weights[agent], 0.5) for agent in AGENTS))
        weights = propose_weights(history, MODELS, AGENTS, learning, seed=number, replay=after_the_drift)
    assert all(own["1"] > 0.8 for own in weights.values())


@pytest.mark.parametrize("learning", [HEDGE, BEST])
def test_what_cannot_be_replayed_leaves_the_weights_as_they_are(learning: OnlineLearning) -> None:
    last = at([0.2, 0.2, 0.6, 0.0])
    history = flown((INITIAL, 0.9), (at([0.0, 1.0, 0.0, 0.0]), 0.3), (last, 1.2))
    found = propose_weights(history, MODELS, ["agent-1"], learning, seed=0, replay=None)
    assert found == {"agent-1": last}


def test_a_fleet_that_wants_no_replays_is_not_replayed() -> None:
    def never(agent: str, candidates: Sequence[Weights]) -> list[float]:
        raise AssertionError("replayed")

    for learner in (HEDGE, BEST):
        none = learner.model_copy(update={"replays": 0})
        found = propose_weights(flown((INITIAL, 0.5)), MODELS, ["agent-1"], none, seed=0, replay=never)
        assert found == {"agent-1": INITIAL}


@given(st.lists(st.integers(0, 10), min_size=1, max_size=8).filter(any), st.floats(-3, 3))
def test_models_that_nothing_tells_apart_keep_their_order_and_new_ones_get_the_share_of_one(
    counts: list[int], loss: float
) -> None:
    last = np.array(counts) / sum(counts)
    found = exponential_weights(last, np.full(len(last), loss))
    assert found.sum() == pytest.approx(1.0)
    assert found[last == 0.0] == pytest.approx(1.0 / len(last))
    kept = last > 0.0
    assert found[kept] / found[kept].sum() == pytest.approx(last[kept])


def test_equals_change_nothing() -> None:
    last = np.array([0.2, 0.5, 0.3])
    same = np.full(3, 0.7)
    assert np.array_equal(exponential_weights(last, same), last)
    assert np.array_equal(best_alone(last, same), [0.0, 1.0, 0.0])
    assert np.array_equal(best_alone(last, np.array([0.2, 0.7, 0.2])), [0.0, 0.0, 1.0])


losses_of_models = st.lists(st.floats(0.0, 2.0), min_size=2, max_size=20).map(np.array)


@settings(max_examples=60)
@given(losses_of_models, st.integers(0, 2**32), st.floats(0.01, 100.0), st.floats(-5.0, 5.0))
def test_exponential_weights_order_models_by_loss_and_forget_scale_and_level(
    losses: np.ndarray, seed: int, scale: float, level: float
) -> None:
    even = np.full(len(losses), 1.0 / len(losses))
    found = exponential_weights(even, losses)
    assert found.sum() == pytest.approx(1.0)
    assert (np.diff(found[np.argsort(losses, kind="stable")]) <= 1e-12).all()
    if np.ptp(losses) > 1e-3:
        np.testing.assert_allclose(exponential_weights(even, scale * losses + level), found, rtol=1e-5, atol=1e-9)
    last = np.random.default_rng(seed).dirichlet(np.ones(len(losses)))
    assert (exponential_weights(last, losses) >= 0.0).all()


def test_the_regret_to_the_best_model_stays_within_that_of_theory() -> None:
    generator = np.random.default_rng(5)
    regrets = []
    for _ in range(50):
        losses = generator.random((HORIZON, 17))
        weights, mine = np.full(17, 1.0 / 17), 0.0
        for row in losses:
            mine += float(weights @ row)
            weights = exponential_weights(weights, row)
        regrets.append(mine - losses.sum(axis=0).min())
    assert max(regrets) < 4.0 * np.sqrt(HORIZON * np.log(17) / 12.0)


def test_what_one_agent_sees_counts_half_for_itself_and_half_for_the_mean() -> None:
    losses = np.array([[0.2, 0.6], [0.4, 0.2]])
    mean = np.array([0.3, 0.4])
    np.testing.assert_allclose(pooled(losses), [POOLED * mean + (1 - POOLED) * row for row in losses])
    np.testing.assert_allclose(pooled(losses[:1]), losses[:1])


@pytest.mark.parametrize("learning", [HEDGE, BEST])
def test_each_model_is_replayed_alone_for_each_agent(learning: OnlineLearning) -> None:
    asked: list[tuple[str, Sequence[Weights]]] = []

    def replay(agent: str, candidates: Sequence[Weights]) -> list[float]:
        asked.append((agent, candidates))
        return [0.3, 0.1, 0.2, 0.4]

    propose_weights(flown((INITIAL, 0.5)), MODELS, AGENTS, learning, seed=0, replay=replay)
    alone = [{key: float(key == one) for key in sorted(MODELS)} for one in sorted(MODELS)]
    assert asked == [(agent, alone) for agent in AGENTS]

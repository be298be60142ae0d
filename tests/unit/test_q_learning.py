from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from fleet.errors import ModelError
from fleet.learning.model import Fit, Transitions
from fleet.learning.qlearning import QLearning
from fleet.learning.reward import Normaliser
from fleet.missions.layout import MOVES
from fleet.spec.learning import SASpec

STATES = 6


def blank(features: int, discount: float = 0.8, seed: int = 1) -> QLearning:
    normaliser = Normaliser(low=(0.0,) * features, high=(1.0,) * features)
    return QLearning.blank(SASpec(discount=discount), tuple(f"f{i}" for i in range(features)), normaliser, seed)


@dataclass(frozen=True, eq=False)
class Problem:
    """A Markov decision process with masks; the last state ends the episode."""

    legal: NDArray[np.bool_]
    after: NDArray[np.int64]
    reward: NDArray[np.float64]

    @staticmethod
    def random(seed: int) -> Problem:
        generator = np.random.default_rng(seed)
        legal = generator.random((STATES, len(MOVES))) < 0.5
        legal[:, 0] = True
        legal[-1] = False
        after = generator.integers(0, STATES, legal.shape)
        return Problem(legal, after, generator.random(legal.shape))

    def optimal(self, discount: float) -> NDArray[np.float64]:
        """Q* by value iteration."""
        q = np.zeros(self.legal.shape)
        for _ in range(500):
            value = np.where(self.legal.any(axis=1), np.where(self.legal, q, -np.inf).max(axis=1), 0.0)
            q = self.reward + discount * value[self.after]
        return q

    def transitions(self, repeats: int) -> Transitions:
        state, move = (np.tile(part, repeats) for part in np.nonzero(self.legal))
        ssv, after = np.eye(STATES), self.after[state, move]
        return Transitions(ssv[state], move, self.reward[state, move], ssv[after], self.legal[after])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_scores_become_the_values_of_the_best_policy(seed: int) -> None:
    problem = Problem.random(seed)
    model = blank(STATES).updated(problem.transitions(4), Fit(epochs=2000, learning_rate=0.5, seed=seed))
    scores = model.scores(np.eye(STATES))
    np.testing.assert_allclose(scores[problem.legal], problem.optimal(0.8)[problem.legal], atol=1e-6)


def test_one_update_is_the_bellman_update_with_a_plus() -> None:
    model = replace(blank(2, discount=0.5), weights=np.random.default_rng(0).random((35, len(MOVES))))
    before, after = np.array([[0.2, 0.7]]), np.array([[0.9, 0.1]])
    legal = np.zeros((1, len(MOVES)), dtype=np.bool_)
    legal[0, [1, 3]] = True
    step = Transitions(before, np.array([2]), np.array([5.0]), after, legal)
    learned = model.updated(step, Fit(learning_rate=0.25))
    phi, old = model.phi(before)[0], model.scores(before)[0, 2]
    target = 5.0 + 0.5 * model.scores(after)[0, [1, 3]].max()
    expected = model.weights.copy()
    expected[:, 2] += 0.25 * (target - old) * phi
    np.testing.assert_allclose(learned.weights, expected, rtol=1e-12)
    assert model.scores(before)[0, 2] == old


def test_the_end_of_an_episode_has_no_value_after_it() -> None:
    model = replace(blank(1, discount=1.0), weights=np.ones((34, len(MOVES))))
    here = np.array([[0.5]])
    end = Transitions(here, np.array([0]), np.array([2.0]), here, np.zeros((1, len(MOVES)), dtype=np.bool_))
    learned = model.updated(end, Fit(epochs=200, learning_rate=0.5))
    assert learned.scores(here)[0, 0] == pytest.approx(2.0)


def test_learning_stays_bounded_where_off_policy_updates_could_run_away() -> None:
    generator = np.random.default_rng(5)
    count = 400
    data = Transitions(
        generator.random((count, 3)), generator.integers(0, 8, count), generator.random(count),
        generator.random((count, 3)), np.ones((count, len(MOVES)), dtype=np.bool_),
    )  # fmt: skip
    model = blank(3, discount=1.0).updated(data, Fit(epochs=100, learning_rate=1.0))
    assert np.abs(model.scores(data.ssv)).max() < 1e4


def test_the_seed_fixes_the_order_of_learning_and_so_the_model() -> None:
    data = Problem.random(0).transitions(3)
    one, again, other = (blank(STATES).updated(data, Fit(seed=seed)).to_bytes() for seed in (7, 7, 8))
    assert one == again != other


def test_a_row_alone_scores_as_it_does_among_many() -> None:
    model = blank(5).updated(_random_transitions(5), Fit(epochs=3))
    rows = np.random.default_rng(2).normal(0.5, 1.0, (257, 5))
    rows[3] = np.nan
    together = model.scores(rows)
    alone = np.vstack([model.scores(rows[i : i + 1]) for i in range(len(rows))])
    np.testing.assert_array_equal(together, alone)
    assert np.isnan(together[3]).all()
    assert np.isfinite(np.delete(together, 3, axis=0)).all()


def test_nothing_to_learn_from_changes_nothing() -> None:
    model = blank(2)
    none = _random_transitions(2, 0)
    assert model.updated(none, Fit()) is model


def test_an_ssv_of_other_features_is_refused() -> None:
    with pytest.raises(ModelError, match="expects SSVs of f0, f1"):
        blank(2).scores(np.zeros((1, 3)))


def _random_transitions(features: int, count: int = 100) -> Transitions:
    generator = np.random.default_rng(9)
    return Transitions(
        generator.random((count, features)), generator.integers(0, 8, count), generator.random(count),
        generator.random((count, features)), generator.random((count, len(MOVES))) < 0.5,
    )  # fmt: skip

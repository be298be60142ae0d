"""Q-learning over the SSV: a linear function of fixed features of the normalised SSV for each move.

    Q(s, a) = w_a . phi(s)
    w_a += alpha * (R + gamma * max over legal a' of Q(s', a') - Q(s, a)) * phi(s)

phi has a constant, the normalised SSV itself, and bumps around seeded centres: smooth enough to carry over to states
that were never seen, rich enough for what a line cannot say. It has length 1, so a step of alpha moves Q(s, a) by at
most alpha of its error. Bumps are 1 / (1 + distance^2 / width^2) and not Gaussian: with sums, products, divisions and
roots alone, in a fixed order, every machine and every batch size gives the same bits.

Source: paper, section "MARL Primer" (whose Bellman line prints `R * gamma max`); Sutton, Barto: Reinforcement
Learning, 2nd edition, chapters 9.5 (features) and 10-11 (semi-gradient control, off-policy).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fleet.errors import ModelError
from fleet.learning.archive import Archive
from fleet.learning.model import Fit, Transitions
from fleet.learning.reward import Normaliser
from fleet.missions.layout import MOVES
from fleet.spec.learning import SAKind, SASpec

FORMAT = "fleet-q-learning/1"
BUMPS = 32
BATCH = 32
_FEW_ROWS = 16
"""So many SSVs are scored at once without loops: a decision in flight is one."""
_LONGEST_HORIZON = 1000.0


@dataclass(frozen=True, eq=False)
class QLearning:
    """A linear Q-function; an SAModel.

    Args:
        features: Names of the SSV's features.
        normaliser: Maps the SSV to [0, 1].
        centres: Centres of the bumps in the normalised SSV, float64 [bumps, features].
        width: Width of the bumps.
        weights: w, float64 [1 + features + bumps, len(MOVES)].
        learning_rate, discount: Alpha and gamma.
    """

    features: tuple[str, ...]
    normaliser: Normaliser
    centres: NDArray[np.float64]
    width: float
    weights: NDArray[np.float64]
    learning_rate: float
    discount: float

    @staticmethod
    def blank(sa: SASpec, features: tuple[str, ...], normaliser: Normaliser, seed: int) -> QLearning:
        """A model that has learned nothing: every score is 0. The seed fixes the centres."""
        count = len(features)
        return QLearning(
            features=features,
            normaliser=normaliser,
            centres=np.random.default_rng(seed).random((BUMPS, count)),
            width=0.35 * float(np.sqrt(count)),
            weights=np.zeros((1 + count + BUMPS, len(MOVES))),
            learning_rate=sa.learning_rate,
            discount=sa.discount,
        )

    @property
    def kind(self) -> SAKind:
        """Q-learning."""
        return SAKind.Q_LEARNING

    def phi(self, ssv: NDArray[np.float64]) -> NDArray[np.float64]:
        """Features of length 1, float64 [n, 1 + features + bumps], of SSVs [n, features]."""
        if ssv.ndim != 2 or ssv.shape[1] != len(self.features):
            raise ModelError(f"the model expects SSVs of {', '.join(self.features)}; it was given {ssv.shape}")
        at = self.normaliser.apply(ssv)
        if len(at) <= _FEW_ROWS:
            distance = _summed((at[:, None] - self.centres) ** 2, axis=2)
        else:
            distance = np.zeros((len(at), len(self.centres)))
            for feature in range(at.shape[1]):
                distance += (at[:, feature : feature + 1] - self.centres[:, feature]) ** 2
        parts = np.hstack([np.ones((len(at), 1)), at, 1.0 / (1.0 + distance / self.width**2)])
        if len(at) <= _FEW_ROWS:
            return np.asarray(parts / np.sqrt(_summed(parts**2, axis=1))[:, None])
        length = np.zeros(len(at))
        for column in range(parts.shape[1]):
            length += parts[:, column] ** 2
        return np.asarray(parts / np.sqrt(length)[:, None])

    def scores(self, ssv: NDArray[np.float64]) -> NDArray[np.float64]:
        """Q of each move, float64 [n, len(MOVES)]; row by row equal to one row alone. A row with NaN gives NaN."""
        phi = self.phi(ssv)
        if len(phi) <= _FEW_ROWS:
            return _summed(phi[:, :, None] * self.weights, axis=1)
        total = np.zeros((len(phi), len(MOVES)))
        for column in range(phi.shape[1]):  # no BLAS: its sums depend on the number of rows
            total += phi[:, column : column + 1] * self.weights[column]
        return total

    def updated(self, transitions: Transitions, fit: Fit) -> QLearning:
        """A model that has also learned from these transitions."""
        if not len(transitions):
            return self
        alpha = self.learning_rate if fit.learning_rate is None else fit.learning_rate
        low, high = self._value_range(transitions.rewards)
        before, after = self.phi(transitions.ssv), self.phi(transitions.next_ssv)
        goes_on = np.asarray(transitions.next_legal.any(axis=1))
        masked = np.where(transitions.next_legal, 0.0, -np.inf)
        masked[~goes_on] = 0.0
        moves = np.eye(len(MOVES))[transitions.moves]
        carried = self.discount * goes_on
        weights = self.weights.copy()
        for order in _orders(len(transitions), fit):
            taken = [each[order] for each in (before, after, masked, moves, transitions.rewards, carried)]
            chosen_often = np.maximum(np.add.reduceat(taken[3], np.arange(0, len(order), BATCH), axis=0), 1.0)
            for batch, often in enumerate(chosen_often):
                now, then, barred, chosen, reward, share = (each[batch * BATCH : (batch + 1) * BATCH] for each in taken)
                best = np.minimum(np.maximum(np.maximum.reduce(then @ weights + barred, axis=1), low), high)
                error = chosen * ((reward + share * best)[:, None] - now @ weights)
                weights += alpha * (now.T @ error) / often
        return replace(self, weights=weights)

    def _value_range(self, rewards: NDArray[np.float64]) -> tuple[float, float]:
        """What a sum of discounted rewards can be at most and at least.

        The bootstrapped value is kept within it, so that off-policy updates of a linear function cannot run away.
        """
        horizon = 1.0 / max(1.0 - self.discount, 1.0 / _LONGEST_HORIZON)
        return min(0.0, float(rewards.min())) * horizon, max(0.0, float(rewards.max())) * horizon

    def to_bytes(self) -> bytes:
        """The saved model; equal models give equal bytes."""
        meta = {
            "features": list(self.features), "low": list(self.normaliser.low), "high": list(self.normaliser.high),
            "width": self.width, "learning_rate": self.learning_rate, "discount": self.discount,
        }  # fmt: skip
        return Archive(FORMAT, meta, {"centres": self.centres, "weights": self.weights}).to_bytes()


def read_qlearning(archive: Archive) -> QLearning:
    """The model of an archive of the format FORMAT. Raises ModelError when it is damaged."""
    try:
        meta = archive.meta
        features = tuple(str(name) for name in meta["features"])
        normaliser = Normaliser(low=tuple(meta["low"]), high=tuple(meta["high"]))
        width, alpha, gamma = float(meta["width"]), float(meta["learning_rate"]), float(meta["discount"])
    except (KeyError, TypeError, ValueError) as error:
        raise ModelError(f"the saved model is damaged: {error!r} in its description") from error
    bumps = archive.arrays["centres"].shape[0] if "centres" in archive.arrays else BUMPS
    return QLearning(
        features, normaliser, archive.array("centres", (bumps, len(features))), width,
        archive.array("weights", (1 + len(features) + bumps, len(MOVES))), alpha, gamma,
    )  # fmt: skip


def _summed(terms: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """The sum along an axis, strictly in order: the same bits as by a loop, and faster where there are few terms."""
    return np.asarray(np.add.accumulate(terms, axis=axis).take(-1, axis=axis))


def _orders(count: int, fit: Fit) -> Iterator[NDArray[np.int64]]:
    """The rows in the order of each epoch, which the seed fixes; BATCH after BATCH is learned from."""
    generator = np.random.default_rng(fit.seed)
    for _ in range(fit.epochs):
        yield generator.permutation(count)

"""The protocol of state-to-action models, and the data that they learn from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fleet.spec.learning import SAKind


@dataclass(frozen=True, eq=False)
class Transitions:
    """Moves that SA chose, and what came of them.

    Args:
        ssv: State-space vectors before the move, float64 [n, features], not normalised.
        moves: The chosen move, index into MOVES, int64 [n].
        rewards: R(s, a, s'), float64 [n].
        next_ssv: State-space vectors after the move, float64 [n, features].
        next_legal: Moves that SA could choose next, bool [n, len(MOVES)]; no true value ends the episode.
    """

    ssv: NDArray[np.float64]
    moves: NDArray[np.int64]
    rewards: NDArray[np.float64]
    next_ssv: NDArray[np.float64]
    next_legal: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.moves)


@dataclass(frozen=True)
class Fit:
    """How a model is updated from transitions.

    Args:
        epochs: Passes over the transitions.
        learning_rate: Alpha; None for the model's own.
        seed: Fixes the order of the transitions.
    """

    epochs: int = 1
    learning_rate: float | None = None
    seed: int = 0


class SAModel(Protocol):
    """SSV in, a score for each of MOVES out. Models are values: an update gives a new one.

    A model from outside joins by this protocol and `learning.models.register`.
    """

    @property
    def kind(self) -> SAKind:
        """Family of the model."""

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the SSV's features that the model expects, in order."""

    def scores(self, ssv: NDArray[np.float64]) -> NDArray[np.float64]:
        """Score of each move, float64 [n, len(MOVES)], for SSVs [n, features]. Row by row equal to one row alone."""

    def updated(self, transitions: Transitions, fit: Fit) -> SAModel:
        """A model that has also learned from these transitions; this one does not change."""

    def to_bytes(self) -> bytes:
        """The saved model; equal models give equal bytes."""

"""DQN and DDPG as SA models: networks that score the moves. Training is `learning.deep`; scoring needs numpy alone.

DQN scores a move with its Q. DDPG's actor gives a number in [-1, 1] for each move, which counts as its score. Either
way the legal move of the highest score is flown: illegal moves are masked at the decision.

Source: Mnih et al.: Human-level control through deep reinforcement learning, 2015; Lillicrap et al.: Continuous control
with deep reinforcement learning, 2016.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fleet.errors import ModelError
from fleet.learning import deep
from fleet.learning.archive import Archive
from fleet.learning.model import Fit, Transitions
from fleet.learning.reward import Normaliser
from fleet.missions.layout import MOVES
from fleet.spec.learning import SAKind, SASpec

FORMAT = "fleet-network/1"
_SCORING = {SAKind.DQN: "q_net.q_net", SAKind.DDPG: "actor.mu"}
"""Where the parameters of the layers that give the scores are."""


@dataclass(frozen=True, eq=False)
class Network:
    """A DQN or a DDPG; an SAModel.

    Args:
        kind: DQN or DDPG.
        features: Names of the SSV's features.
        normaliser: Maps the SSV to [0, 1].
        parameters: Every parameter of the policy, targets and critics included, by Stable-Baselines3's names.
        learning_rate, discount: Alpha and gamma.
    """

    kind: SAKind
    features: tuple[str, ...]
    normaliser: Normaliser
    parameters: Mapping[str, NDArray[np.float32]]
    learning_rate: float
    discount: float

    def scores(self, ssv: NDArray[np.float64]) -> NDArray[np.float64]:
        """Score of each move, float64 [n, len(MOVES)]; row by row equal to one row alone. A row with NaN gives NaN."""
        if ssv.ndim != 2 or ssv.shape[1] != len(self.features):
            raise ModelError(f"the model expects SSVs of {', '.join(self.features)}; it was given {ssv.shape}")
        value = self.normaliser.apply(ssv)
        layers = self._layers()
        for number, (weight, bias) in enumerate(layers):
            total = np.zeros((len(value), len(bias))) + bias
            for column in range(weight.shape[1]):  # no BLAS: its sums depend on the number of rows
                total += value[:, column : column + 1] * weight[:, column]
            value = np.maximum(total, 0.0) if number < len(layers) - 1 else total
        return _tanh(value) if self.kind is SAKind.DDPG else value

    def updated(self, transitions: Transitions, fit: Fit) -> Network:
        """A model that has also learned from these transitions; they fill its replay buffer.

        Raises:
            ModelError: the extra `deep` is not installed.
        """
        if not len(transitions):
            return self
        rate = self.learning_rate if fit.learning_rate is None else fit.learning_rate
        before, after = self.normaliser.apply(transitions.ssv), self.normaliser.apply(transitions.next_ssv)
        sample = replace(transitions, ssv=before, next_ssv=after)
        settings = deep.Settings(self.kind, rate, self.discount)
        return replace(self, parameters=deep.trained(settings, self.parameters, sample, fit))

    def to_bytes(self) -> bytes:
        """The saved model; equal models give equal bytes."""
        meta = {
            "kind": self.kind.value, "features": list(self.features), "low": list(self.normaliser.low),
            "high": list(self.normaliser.high), "learning_rate": self.learning_rate, "discount": self.discount,
        }  # fmt: skip
        return Archive(FORMAT, meta, self.parameters).to_bytes()

    def _layers(self) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Weights [out, in] and biases [out] of the layers that give the scores."""
        prefix = _SCORING[self.kind]
        numbers = sorted({int(name.split(".")[2]) for name in self.parameters if name.startswith(f"{prefix}.")})
        return [
            (
                self.parameters[f"{prefix}.{number}.weight"].astype(np.float64),
                self.parameters[f"{prefix}.{number}.bias"].astype(np.float64),
            )
            for number in numbers
        ]


def blank_network(sa: SASpec, features: tuple[str, ...], normaliser: Normaliser, seed: int) -> Network:
    """A network with random weights.

    Raises:
        ModelError: the extra `deep` is not installed.
    """
    settings = deep.Settings(sa.kind, sa.learning_rate, sa.discount)
    parameters = deep.initial(settings, len(features), seed)
    return Network(sa.kind, features, normaliser, parameters, sa.learning_rate, sa.discount)


def read_network(archive: Archive) -> Network:
    """The model of an archive of the format FORMAT. Raises ModelError when it is damaged."""
    try:
        meta = archive.meta
        network = Network(
            SAKind(meta["kind"]), tuple(str(name) for name in meta["features"]),
            Normaliser(low=tuple(meta["low"]), high=tuple(meta["high"])), dict(archive.arrays),
            float(meta["learning_rate"]), float(meta["discount"]),
        )  # fmt: skip
        shape = network.scores(np.zeros((1, len(network.features)))).shape
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise ModelError(f"the saved model is damaged: {error!r}") from error
    if shape != (1, len(MOVES)):
        raise ModelError(f"the saved model scores {shape[1]} moves; there are {len(MOVES)}")
    return network


def _tanh(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Number by number: numpy's own takes other paths for many numbers than for few."""
    flat = [math.tanh(value) for value in values.ravel().tolist()]
    return np.array(flat, dtype=np.float64).reshape(values.shape)

"""Training of DQN and DDPG networks: the one door to Stable-Baselines3 and torch (extra `deep`).

Networks learn off-line: transitions of simulated or flown missions fill the replay buffer, then gradient steps are
taken. Stable-Baselines3's DQN takes the maximum over all moves in its target, not over the legal ones.

Sums on one torch thread and seeded sampling make training depend on its arguments alone.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fleet.errors import ModelError
from fleet.learning.model import Fit, Transitions
from fleet.missions.layout import MOVES
from fleet.spec.learning import SAKind

Parameters = dict[str, NDArray[np.float32]]
"""Every parameter of a policy by Stable-Baselines3's names."""

LAYERS = (64, 64)
BATCH = 64
SYNC_STEPS = 64
"""After so many gradient steps DQN's target network becomes the learned one."""
DDPG_PASSES = 4
"""DDPG takes so many times the steps of DQN: it learns two networks, one through the other."""
CRITIC_SHARE = 0.75
"""Share of DDPG's steps in which only the critic learns."""
ADAM_SHARE = 0.01
"""Adam's step as a share of the spec's learning rate, whose default is meant for Q-learning."""


@dataclass(frozen=True)
class Settings:
    """What the algorithm needs to know beside its data."""

    kind: SAKind
    learning_rate: float
    discount: float


def initial(settings: Settings, features: int, seed: int) -> Parameters:
    """Random parameters of a network over so many features.

    Raises:
        ModelError: the extra `deep` is not installed.
    """
    with _torch(settings.kind, seed):
        return _parameters(_algorithm(settings, features, seed, 1))


def trained(
    settings: Settings, parameters: Mapping[str, NDArray[np.float32]], sample: Transitions, fit: Fit
) -> Parameters:
    """Parameters after so many passes over transitions whose SSVs are normalised.

    Raises:
        ModelError: the extra `deep` is not installed, or the parameters are not of this algorithm.
    """
    with _torch(settings.kind, fit.seed) as torch:
        algorithm = _algorithm(settings, sample.ssv.shape[1], fit.seed, len(sample))
        try:
            algorithm.policy.load_state_dict({name: torch.tensor(value) for name, value in parameters.items()})
        except RuntimeError as error:
            raise ModelError(f"the saved {settings.kind} does not fit: {error}") from error
        _fill(algorithm.replay_buffer, settings.kind, sample, fit.seed)
        steps = math.ceil(fit.epochs * len(sample) / BATCH)
        if settings.kind is SAKind.DQN:
            _train_dqn(algorithm, steps)
        else:
            _train_ddpg(algorithm, steps * DDPG_PASSES)
        return _parameters(algorithm)


def _train_dqn(algorithm: Any, steps: int) -> None:
    for start in range(0, steps, SYNC_STEPS):
        algorithm.train(min(SYNC_STEPS, steps - start), BATCH)
        algorithm.q_net_target.load_state_dict(algorithm.q_net.state_dict())


def _train_ddpg(algorithm: Any, steps: int) -> None:
    """The critic first, alone: an actor that follows a critic that knows nothing ends in a corner, where the gradient
    of its tanh is 0, and never leaves it."""
    alone = round(steps * CRITIC_SHARE)
    algorithm.policy_delay = steps + 1
    for start in range(0, alone, SYNC_STEPS):
        algorithm.train(min(SYNC_STEPS, alone - start), BATCH)
        algorithm.critic_target.load_state_dict(algorithm.critic.state_dict())
    algorithm.policy_delay = 1
    algorithm.train(steps - alone, BATCH)


@contextmanager
def _torch(kind: SAKind, seed: int) -> Iterator[Any]:
    """torch, seeded, on one thread; the process's own random state and threads come back."""
    torch = _import("torch", kind)
    seeding = _import("stable_baselines3.common.utils", kind)
    threads, numbers = torch.get_num_threads(), torch.get_rng_state()
    legacy = np.random.get_state()  # noqa: NPY002 - Stable-Baselines3 draws from it, and others may too
    torch.set_num_threads(1)
    seeding.set_random_seed(seed % 2**32)
    try:
        yield torch
    finally:
        torch.set_num_threads(threads)
        torch.set_rng_state(numbers)
        np.random.set_state(legacy)  # noqa: NPY002 - see above


def _algorithm(settings: Settings, features: int, seed: int, buffer: int) -> Any:
    library = _import("stable_baselines3", settings.kind)
    logger = _import("stable_baselines3.common.logger", settings.kind)
    rest: dict[str, Any] = {
        "learning_rate": settings.learning_rate * ADAM_SHARE, "gamma": settings.discount, "buffer_size": buffer,
        "policy_kwargs": {"net_arch": list(LAYERS)}, "seed": seed % 2**32, "device": "cpu",
    }  # fmt: skip
    algorithm = getattr(library, settings.kind.value)("MlpPolicy", _spaces(settings.kind, features), **rest)
    algorithm.set_logger(logger.Logger(folder=None, output_formats=[]))
    return algorithm


def _spaces(kind: SAKind, features: int) -> Any:
    """An environment that only says what an SSV and a move look like: nothing is flown in it."""
    gymnasium = _import("gymnasium", kind)
    scores = gymnasium.spaces.Box(-1.0, 1.0, (len(MOVES),), np.float32)

    class Spaces(gymnasium.Env):  # type: ignore[misc, name-defined]  # the library is not there in every installation
        observation_space = gymnasium.spaces.Box(0.0, 1.0, (features,), np.float32)
        action_space = gymnasium.spaces.Discrete(len(MOVES)) if kind is SAKind.DQN else scores

    return Spaces()


def _import(module: str, kind: SAKind) -> Any:
    """By name, so that types are checked alike where the extra is installed and where it is not."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ModelError(f"{kind} needs the extra `deep`: pip install 'fleet-computer[deep]'") from error


def _fill(buffer: Any, kind: SAKind, sample: Transitions, seed: int) -> None:
    actions = sample.moves[:, None] if kind is SAKind.DQN else _score_vectors(sample.moves, seed)
    buffer.observations[:, 0] = sample.ssv
    buffer.next_observations[:, 0] = sample.next_ssv
    buffer.actions[:, 0] = actions
    buffer.rewards[:, 0] = sample.rewards
    buffer.dones[:, 0] = ~sample.next_legal.any(axis=1)
    buffer.full = True


def _score_vectors(moves: NDArray[np.int64], seed: int) -> NDArray[np.float64]:
    """DDPG's action is a score for each move, and the highest is flown: random scores that lead to these moves.

    A critic that saw nothing but unit vectors would say anything about all others, and the actor would believe it.
    """
    scores = np.random.default_rng(seed).uniform(-1.0, 1.0, (len(moves), len(MOVES)))
    rows = np.arange(len(moves))
    highest = scores.argmax(axis=1)
    scores[rows, highest], scores[rows, moves] = scores[rows, moves], scores[rows, highest]
    return scores


def _parameters(algorithm: Any) -> Parameters:
    return {name: value.detach().cpu().numpy().copy() for name, value in algorithm.policy.state_dict().items()}

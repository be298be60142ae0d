"""Replays: an agent's last mission flown again with other weights, over what its fleet's records say of the field."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fleet.energy.accounting import EnergyModel
from fleet.learning.blend import blend
from fleet.learning.model import SAModel
from fleet.learning.reward import RewardModel
from fleet.missions.layout import MOVES, Layout
from fleet.simulator.batch import Batch, Flown, fly
from fleet.usefulness.history import Weights
from fleet.usefulness.loss import Effort, MissionLoss, effort

Tables = Mapping[str, NDArray[np.float64]]
"""Scores of each model in each state, [cells, len(MOVES)]."""
_AT_ONCE = 16
"""Replays that are flown side by side: each has scores of its own for the whole field."""


@dataclass(frozen=True, eq=False)
class Replayer:
    """Flies the last mission again, each agent alone in its part; a `usefulness.weights.Replay`.

    Args:
        layout: Who flew where.
        agents: Names of the agents, in the layout's order.
        ssv: What is believed of each state, float64 [cells, features]; see `usefulness.belief`.
        flown: Weights of each agent in the last mission.
        before: The models that flew in it.
        after: The models as they fly in the next mission.
        reward: Rewards and thresholds.
        energy: Costs of actions.
        loss: The loss of the last mission.
        efforts: What each agent did in it.
    """

    layout: Layout
    agents: Sequence[str]
    ssv: NDArray[np.float64]
    flown: Mapping[str, Weights]
    before: Mapping[str, SAModel]
    after: Mapping[str, SAModel]
    reward: RewardModel
    energy: EnergyModel
    loss: MissionLoss
    efforts: Mapping[str, Effort]
    _tables: tuple[Tables, Tables] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_tables", (self._score_all(self.before), self._score_all(self.after)))

    def __call__(self, agent: str, candidates: Sequence[Weights]) -> list[float]:
        """The agent's loss with the next models and these weights.

        The last mission is replayed too, and only the difference to it counts: what is wrong in the belief is wrong
        in both.
        """
        index = list(self.agents).index(agent)
        before, after = self._tables
        last = self._efforts(index, blend(before, self.flown[agent])[None])[0]
        losses: list[float] = []
        for start in range(0, len(candidates), _AT_ONCE):
            scores = np.stack([blend(after, weights) for weights in candidates[start : start + _AT_ONCE]])
            others = self._efforts(index, scores)
            losses += [self.loss.of(self.efforts[agent].plus(other, minus=last)) for other in others]
        return losses

    def _score_all(self, models: Mapping[str, SAModel]) -> dict[str, NDArray[np.float64]]:
        """Scores of each model in each state with data, [cells, len(MOVES)]; 0 elsewhere."""
        valid = np.flatnonzero(self.layout.group_of >= 0)
        tables = {}
        for key, model in models.items():
            tables[key] = np.zeros((self.layout.grid.cells, len(MOVES)))
            tables[key][valid] = model.scores(self.ssv[valid])
        return tables

    def _efforts(self, agent: int, scores: NDArray[np.float64]) -> list[Effort]:
        flown = fly_alone(self.layout, agent, scores, self.reward, self.reward.reward(self.ssv))
        energies_j = [self.energy.flight(flown.counts(mission, 0)).energy_j for mission in range(len(scores))]
        return [
            effort(self.layout, agent, int(flown.captures[mission, 0]), energy_j, self.energy)
            for mission, energy_j in enumerate(energies_j)
        ]


def fly_alone(
    layout: Layout, agent: int, scores: NDArray[np.float64], reward: RewardModel, rewards: NDArray[np.float64]
) -> Flown:
    """One agent's part flown once with each of some score tables, without random moves.

    Args:
        scores: float64 [n, cells, len(MOVES)].
        rewards: Reward of a transition into each state, float64 [cells].
    """
    alone = replace(
        layout, parts=(layout.parts[agent],), starts=(layout.starts[agent],), actions=(layout.actions[agent],)
    )
    count = len(scores)
    batch = Batch(
        scores=scores,
        table=np.arange(count, dtype=np.int64)[:, None],
        rewards=rewards[None],
        reward_of=np.zeros(count, dtype=np.int64),
        utility_thresholds=np.full(count, reward.utility_threshold),
        visited_thresholds=np.full(count, reward.visited_threshold, dtype=np.int64),
        exploration=np.zeros(count),
        missions=np.zeros(count, dtype=np.int64),
    )
    return fly(alone, batch)

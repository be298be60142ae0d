"""Retraining one subset's model from the records of a mission."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fleet.aggregation.subsets import Subset
from fleet.errors import MissionError
from fleet.learning.experience import concatenate, from_log
from fleet.learning.model import Fit, SAModel
from fleet.learning.reward import RewardModel
from fleet.missions.records import Record
from fleet.spec.learning import Retraining


def retrain(
    model: SAModel,
    logs: Mapping[str, Sequence[Record]],
    subset: Subset,
    reward: RewardModel,
    retraining: Retraining,
    seed: int,
) -> tuple[SAModel, int]:
    """Update a model with what the agents of a subset have seen.

    Args:
        model: The subset's last model; the initial one when it has none.
        logs: Records of the mission by agent; an agent that recorded nothing has an empty log. Others are not read.
        seed: Fixes the order in which the model sees the moves.
    Returns:
        The new model and the number of moves that it learned from; the same model when there are none.
    Raises:
        MissionError: there is no log of one of the subset's agents.
        ModelError: the records' SSVs do not fit the model.
    """
    missing = [agent for agent in subset.agents if agent not in logs]
    if missing:
        raise MissionError(f"subset {subset.key} has no log of {', '.join(missing)}")
    transitions = concatenate([from_log(logs[agent], reward) for agent in subset.agents])
    if not len(transitions):
        return model, 0
    fit = Fit(epochs=retraining.epochs, learning_rate=retraining.learning_rate, seed=seed)
    return model.updated(transitions, fit), len(transitions)

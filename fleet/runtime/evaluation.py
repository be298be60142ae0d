"""Eval() of a whole mission, by whichever workflow finds that every agent has landed.

Two workflows that land at the same moment may both evaluate: they write the same document.
"""

from __future__ import annotations

import io
import logging
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Environment
from fleet.errors import ObjectNotFound
from fleet.functions import wire
from fleet.functions.contract import EvalClient, Evaluation, FeatureSpace, Metrics
from fleet.learning.reward import RewardModel
from fleet.missions.documents import Landing, MissionEvaluation, judge
from fleet.missions.records import Record, read_log
from fleet.runtime.settings import Settings

_log = logging.getLogger(__name__)


def evaluate_if_last(settings: Settings, evaluator: EvalClient) -> bool:
    """Evaluate the mission when every agent has landed and nobody has done it yet.

    Returns:
        Whether the mission is over.

    Raises:
        FunctionError: Eval() failed.
    """
    storage, paths, number = settings.storage, settings.paths, settings.mission
    if storage.exists(paths.evaluation(number)):
        return True
    landings = read_landings(settings)
    agents = [agent.name for agent in settings.fleet.agents.resolved]
    if len(landings) < len(agents):
        return False
    logs = read_logs(settings, agents)
    reward = RewardModel.model_validate_json(storage.read(paths.reward))
    memories = {agent: captured_ssvs(records) for agent, records in logs.items()}
    environment = wire.decode_environment(wire.load(storage.read(paths.environment(number))))
    fs = feature_space_of(memories, reward.features, environment)
    metrics = Metrics(tuple(landings[agent].metrics for agent in agents))
    evaluation = evaluator.evaluate(fs, metrics)
    storage.write(paths.artefacts(number), pack_artefacts(evaluation))
    document = MissionEvaluation(
        number=number,
        context=settings.order.context,
        metrics=dict(evaluation.metrics),
        goals=judge(settings.fleet.goals, dict(evaluation.metrics)),
        agents=metrics.agents,
        failures={agent: landing.message for agent, landing in sorted(landings.items()) if landing.failed},
    )
    storage.write(paths.evaluation(number), document.model_dump_json(by_alias=True, indent=1).encode())
    _log.info("mission %d is over", number)
    return True


def read_landings(settings: Settings) -> dict[str, Landing]:
    """The landings of the agents that have landed, by name."""
    found = {}
    for agent in settings.fleet.agents.resolved:
        try:
            data = settings.storage.read(settings.paths.landing(settings.mission, agent.name))
        except ObjectNotFound:
            continue
        found[agent.name] = Landing.model_validate_json(data)
    return found


def read_logs(settings: Settings, agents: Sequence[str]) -> dict[str, tuple[Record, ...]]:
    """The records of some agents in this mission; an agent that recorded nothing has none."""
    logs = {}
    for agent in agents:
        try:
            logs[agent] = read_log(settings.storage.read(settings.paths.log(settings.mission, agent)))
        except ObjectNotFound:
            logs[agent] = ()
    return logs


def captured_ssvs(records: Sequence[Record]) -> dict[int, NDArray[np.float64]]:
    """SSV of each captured state of one agent."""
    return {record.cell: np.array(record.ssv) for record in records if record.captured}


def feature_space_of(
    memories: Mapping[str, Mapping[int, NDArray[np.float64]]], features: Sequence[str], environment: Environment
) -> FeatureSpace:
    """FS of a mission: every captured state once; of states that several agents captured, the first agent's SSV."""
    merged: dict[int, NDArray[np.float64]] = {}
    for memory in memories.values():
        for cell, ssv in memory.items():
            merged.setdefault(cell, ssv)
    states = np.array(sorted(merged), dtype=np.int64)
    rows = [merged[int(state)] for state in states]
    ssv = np.array(rows, dtype=np.float64).reshape(len(rows), len(features))
    return FeatureSpace(tuple(features), states, ssv, environment)


def pack_artefacts(evaluation: Evaluation) -> bytes:
    """The artefacts as an npz file."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **dict(evaluation.artefacts))
    return buffer.getvalue()

"""The aggregator of one subset of agents: retrains that subset's model from a mission's records."""

from __future__ import annotations

import logging

from fleet.aggregation.retrain import retrain
from fleet.aggregation.subsets import Subset, subsets_for
from fleet.errors import MissionError
from fleet.learning.model import SAModel
from fleet.learning.models import load_model
from fleet.learning.planner import PlannerModel, load_planner
from fleet.learning.reward import RewardModel
from fleet.missions.documents import INITIAL, RetrainingReport
from fleet.randomness import named_seed
from fleet.runtime.evaluation import read_logs
from fleet.runtime.meter import Meter
from fleet.runtime.remembering import stored_environment
from fleet.runtime.settings import Settings
from fleet.spec.learning import SAKind

_log = logging.getLogger(__name__)


def aggregate(settings: Settings) -> None:
    """Retrain a subset's model; nothing happens when that was already done for this mission.

    Raises:
        MissionError: the fleet has no such subset.
    """
    storage, paths, number, key = settings.storage, settings.paths, settings.mission, settings.subset
    if storage.exists(paths.retraining(number, key)):
        return
    subsets = {subset.key: subset for subset in subsets_for(settings.fleet)}
    if key not in subsets:
        raise MissionError(f"FLEET_SUBSET is {key!r}; the fleet aggregates {', '.join(subsets)}")
    meter = Meter(settings.energy)
    model_paths = {reference.key: reference.path for reference in settings.order.models}
    model, transitions = _retrained(settings, subsets[key], storage.read(model_paths.get(key, model_paths[INITIAL])))
    storage.write(paths.model(number, key), model.to_bytes())
    report = RetrainingReport(
        number=number, subset=key, transitions=transitions, level=settings.level, **meter.read().model_dump()
    )
    storage.write(paths.retraining(number, key), report.model_dump_json(by_alias=True, indent=1).encode())
    _log.info("subset %s learned from %d moves", key, transitions)


def _retrained(settings: Settings, subset: Subset, saved: bytes) -> tuple[SAModel | PlannerModel, int]:
    """A saved model that has also learned from a subset's records, and from how many of them."""
    storage, paths, number = settings.storage, settings.paths, settings.mission
    logs = read_logs(settings, subset.agents)
    reward = RewardModel.model_validate_json(storage.read(paths.reward))
    if settings.fleet.sa.kind is SAKind.PLANNER:
        from fleet.learning.planner_lessons import retrain_planner  # noqa: PLC0415 - loads scipy and numba

        return retrain_planner(load_planner(saved, reward.features), logs, stored_environment(settings), reward)
    seed = named_seed(settings.order.seed, f"retrain/{number}/{subset.key}")
    return retrain(load_model(saved), logs, subset, reward, settings.fleet.online_learning.retraining, seed)

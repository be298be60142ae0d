"""The aggregator of one subset of agents: retrains that subset's model from a mission's records."""

from __future__ import annotations

import logging

from fleet.aggregation.retrain import retrain
from fleet.aggregation.subsets import subsets_for
from fleet.errors import MissionError
from fleet.learning.models import load_model
from fleet.learning.reward import RewardModel
from fleet.missions.documents import INITIAL, RetrainingReport
from fleet.randomness import named_seed
from fleet.runtime.evaluation import read_logs
from fleet.runtime.meter import Meter
from fleet.runtime.settings import Settings

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
    model, transitions = retrain(
        load_model(storage.read(model_paths.get(key, model_paths[INITIAL]))),
        read_logs(settings, subsets[key].agents),
        subsets[key],
        RewardModel.model_validate_json(storage.read(paths.reward)),
        settings.fleet.online_learning.retraining,
        named_seed(settings.order.seed, f"retrain/{number}/{key}"),
    )
    storage.write(paths.model(number, key), model.to_bytes())
    report = RetrainingReport(
        number=number, subset=key, transitions=transitions, level=settings.level, **meter.read().model_dump()
    )
    storage.write(paths.retraining(number, key), report.model_dump_json(by_alias=True, indent=1).encode())
    _log.info("subset %s learned from %d moves", key, transitions)

"""The trainer: reward shaping and the first SA before the first mission, model weights between missions."""

from __future__ import annotations

import logging
from pathlib import Path

from fleet.aggregation.subsets import write_subsets
from fleet.errors import MissionError, ModelError, ObjectNotFound
from fleet.functions.clients import open_eval, open_map
from fleet.learning.lessons import Lessons
from fleet.learning.model import SAModel
from fleet.learning.models import load_model
from fleet.learning.planner import PlannerModel, load_planner
from fleet.learning.progress import Progress
from fleet.learning.reward import RewardModel
from fleet.learning.workbench import Workbench
from fleet.missions.documents import TrainerReport
from fleet.runtime.meter import Meter
from fleet.runtime.settings import Settings
from fleet.runtime.weighing import weigh
from fleet.spec.learning import SAKind, SASpec
from fleet.storage.open import open_storage

_log = logging.getLogger(__name__)


def run_trainer(settings: Settings) -> None:
    """Do the trainer's task; what is in storage already is not done again.

    Raises:
        MissionError: there is no such task.
        FleetError: the task cannot be done.
    """
    meter = Meter(settings.energy)
    write_subsets(settings.fleet, settings.storage, settings.paths)
    match settings.task:
        case "Train":
            prepare(settings)
        case "Weigh":
            weigh(settings)
        case _:
            raise MissionError(f"FLEET_TASK is {settings.task!r}; the trainer's tasks are Train and Weigh")
    path = settings.paths.trainer_report(settings.mission)
    if not settings.storage.exists(path):
        report = TrainerReport(task=settings.task, number=settings.mission, **meter.read().model_dump())
        settings.storage.write(path, report.model_dump_json(by_alias=True, indent=1).encode())


def prepare(settings: Settings) -> None:
    """Shape the reward and train the first model."""
    fleet, storage, paths = settings.fleet, settings.storage, settings.paths
    map_client = open_map(fleet.map, settings.map_url)
    bench = Workbench(fleet, storage, paths, map_client, open_eval(fleet.eval, settings.eval_url))
    pretrained = read_pretrained(fleet.sa) if fleet.sa.pretrained else None
    lessons = Lessons(bench, pretrained, settings.workers, _tell)
    if not storage.exists(paths.reward):
        lessons.shape()
    if not storage.exists(paths.initial_model):
        lessons.train(RewardModel.model_validate_json(storage.read(paths.reward)))


def read_pretrained(sa: SASpec) -> SAModel | PlannerModel:
    """The saved model at a storage address, or at a path from the folder of the functions.

    Raises:
        ModelError: there is none, or it is damaged or of another kind.
    """
    reference = sa.pretrained or ""
    load = load_planner if sa.kind is SAKind.PLANNER else load_model
    try:
        if "://" in reference:
            folder, _, name = reference.rpartition("/")
            return load(open_storage(folder).read(name))
        return load(Path(reference).read_bytes())
    except (OSError, ObjectNotFound) as error:
        raise ModelError(f"sa.pretrained names {reference}, which cannot be read: {error}") from error


def _tell(progress: Progress) -> None:
    best = "" if progress.best_loss is None else f", best loss {progress.best_loss:.4f}"
    met = ", goals met" if progress.goals_met else ""
    note = f": {progress.message}" if progress.message else ""
    _log.info("%s %d of %d%s%s%s", progress.stage.lower(), progress.done, progress.total, best, met, note)

"""The trainer: reward shaping and the first SA before the first mission, model weights between missions."""

from __future__ import annotations

import logging
from pathlib import Path

from fleet.errors import MissionError, ModelError, ObjectNotFound
from fleet.functions.clients import open_eval, open_map
from fleet.learning.model import SAModel
from fleet.learning.models import load_model
from fleet.learning.practice import Grounds
from fleet.learning.progress import Progress
from fleet.learning.reward import Normaliser, RewardModel
from fleet.learning.run import Run
from fleet.learning.shaping import shape
from fleet.learning.training import train
from fleet.learning.workbench import Workbench, open_workbench
from fleet.runtime.settings import Settings
from fleet.runtime.weighing import weigh
from fleet.spec.functions import ContextUse
from fleet.storage.open import open_storage

_log = logging.getLogger(__name__)


def run_trainer(settings: Settings) -> None:
    """Do the trainer's task; what is in storage already is not done again.

    Raises:
        MissionError: there is no such task.
        FleetError: the task cannot be done.
    """
    match settings.task:
        case "Train":
            prepare(settings)
        case "Weigh":
            weigh(settings)
        case _:
            raise MissionError(f"FLEET_TASK is {settings.task!r}; the trainer's tasks are Train and Weigh")


def prepare(settings: Settings) -> None:
    """Shape the reward and train the first model."""
    fleet, storage, paths = settings.fleet, settings.storage, settings.paths
    map_client = open_map(fleet.map, settings.map_url)
    bench = open_workbench(fleet, storage, paths, map_client, open_eval(fleet.eval, settings.eval_url))
    pretrained = read_pretrained(fleet.sa.pretrained) if fleet.sa.pretrained else None
    seed = fleet.missions.seed
    if not storage.exists(paths.reward):
        known = [*bench.terrains(ContextUse.SHAPING), *bench.terrains(ContextUse.TRAINING)]
        normaliser = Normaliser.over([terrain.ssv for terrain in known])
        run = Run(storage, paths.shaping, seed, settings.workers, pretrained, listener=_tell)
        reward = shape(fleet, grounds_of(bench, ContextUse.SHAPING), run, normaliser)
        storage.write(paths.reward, reward.model_dump_json(by_alias=True, indent=1).encode())
    reward = RewardModel.model_validate_json(storage.read(paths.reward))
    if not storage.exists(paths.initial_model):
        run = Run(storage, paths.training, seed, settings.workers, pretrained, listener=_tell)
        model = train(fleet, grounds_of(bench, ContextUse.TRAINING), reward, run)
        storage.write(paths.initial_model, model.to_bytes())


def grounds_of(bench: Workbench, use: ContextUse) -> Grounds:
    """What missions are simulated over for one use of contexts."""
    agents = tuple(agent.name for agent in bench.agents)
    return Grounds(bench.terrains(use), agents, bench.energy, bench.evaluator)


def read_pretrained(reference: str) -> SAModel:
    """The saved model at a storage address, or at a path from the folder of the functions.

    Raises:
        ModelError: there is none, or it is damaged.
    """
    try:
        if "://" in reference:
            folder, _, name = reference.rpartition("/")
            return load_model(open_storage(folder).read(name))
        return load_model(Path(reference).read_bytes())
    except (OSError, ObjectNotFound) as error:
        raise ModelError(f"sa.pretrained names {reference}, which cannot be read: {error}") from error


def _tell(progress: Progress) -> None:
    best = "" if progress.best_loss is None else f", best loss {progress.best_loss:.4f}"
    met = ", goals met" if progress.goals_met else ""
    note = f": {progress.message}" if progress.message else ""
    _log.info("%s %d of %d%s%s%s", progress.stage.lower(), progress.done, progress.total, best, met, note)

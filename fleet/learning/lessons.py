"""Reward shaping and first training of a fleet, from its workbench to the objects in storage that roles read."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.errors import ModelError, TrainingError
from fleet.learning.model import SAModel
from fleet.learning.network import Network
from fleet.learning.planner import PlannerModel
from fleet.learning.planner_lessons import first_planner, train_planner
from fleet.learning.progress import Listener, nobody
from fleet.learning.qlearning import QLearning
from fleet.learning.rehearsals import given_planner, shape_planner
from fleet.learning.reward import Normaliser, RewardModel
from fleet.learning.run import Run
from fleet.learning.shaping import given_reward, shape
from fleet.learning.training import train
from fleet.learning.workbench import Workbench
from fleet.spec.functions import ContextUse
from fleet.spec.learning import SAKind


@dataclass(frozen=True)
class Lessons:
    """How a fleet learns before its first mission.

    Args:
        bench: The fleet's contexts, Map() and Eval().
        pretrained: SA to start from; blank when None.
        workers: Worker processes; the result does not depend on it.
        listener: Told about progress.
    """

    bench: Workbench
    pretrained: SAModel | PlannerModel | None = None
    workers: int = 1
    listener: Listener = nobody

    def shape(self) -> RewardModel:
        """Find the reward, and write it to storage. Killed and started again it goes on, with the same result.

        Raises:
            TrainingError: there is nothing to learn from.
            FunctionError: Map() or Eval() failed.
        """
        bench = self.bench
        normaliser = self._normaliser()
        if self._plans:
            reward = self._shape_planner(normaliser)
        elif bench.fleet.contexts_for(ContextUse.SHAPING):
            grounds = bench.grounds(ContextUse.SHAPING)
            reward = shape(bench.fleet, grounds, self._run(bench.paths.shaping), normaliser)
        else:
            features = self.pretrained.features if self.pretrained else bench.map_client.features
            reward = given_reward(bench.fleet, features, normaliser)
        bench.storage.write(bench.paths.reward, reward.model_dump_json(by_alias=True, indent=1).encode())
        return reward

    def train(self, reward: RewardModel) -> SAModel | PlannerModel:
        """Train the first SA, and write it to storage; a pre-trained one stays as it is without training contexts.

        Raises:
            TrainingError: there is nothing to learn from.
            FunctionError: Map() or Eval() failed.
        """
        bench = self.bench
        model: SAModel | PlannerModel
        if self._plans:
            model = self._train_planner(reward)
        elif self.pretrained is not None and not bench.fleet.contexts_for(ContextUse.TRAINING):
            model = self.pretrained
        else:
            model = train(bench.fleet, bench.grounds(ContextUse.TRAINING), reward, self._run(bench.paths.training))
        bench.storage.write(bench.paths.initial_model, model.to_bytes())
        return model

    @property
    def _plans(self) -> bool:
        return self.bench.fleet.sa.kind is SAKind.PLANNER

    def _shape_planner(self, normaliser: Normaliser) -> RewardModel:
        bench = self.bench
        if bench.fleet.contexts_for(ContextUse.SHAPING):
            return shape_planner(
                bench.fleet, bench.grounds(ContextUse.SHAPING), self._run(bench.paths.shaping), normaliser
            )
        known = {terrain.environment.truth_name for terrain in bench.terrains(ContextUse.TRAINING)}
        truth_name = known.pop() if len(known) == 1 else ""
        return given_planner(bench.fleet, bench.map_client.features, normaliser, truth_name)

    def _train_planner(self, reward: RewardModel) -> PlannerModel:
        bench = self.bench
        grounds = bench.grounds(ContextUse.TRAINING)
        start = self.pretrained or first_planner(reward)
        if not isinstance(start, PlannerModel):
            raise ModelError(f"the pre-trained model is of kind {start.kind}, but sa.kind is {SAKind.PLANNER}")
        if start.features != reward.features:
            raise ModelError(
                f"the pre-trained model expects the features {', '.join(start.features)}, but Map() gives "
                f"{', '.join(reward.features)}; leave sa.pretrained out, or choose the Map() it was trained with"
            )
        missions = bench.fleet.training.epochs * bench.fleet.training.periods
        return train_planner(start, grounds, reward, missions, self._run(bench.paths.training))

    def _normaliser(self) -> Normaliser:
        """Over all that the fleet learns from, else that of the pre-trained SA; what it flies over is not known yet."""
        terrains = [*self.bench.terrains(ContextUse.SHAPING), *self.bench.terrains(ContextUse.TRAINING)]
        if terrains:
            return Normaliser.over([terrain.ssv for terrain in terrains])
        if isinstance(self.pretrained, QLearning | Network):
            return self.pretrained.normaliser
        if self._plans:
            count = len(self.bench.map_client.features)
            return Normaliser(low=(0.0,) * count, high=(1.0,) * count)
        raise TrainingError("no context is for Shaping or Training, so the features' ranges are not known; give one")

    def _run(self, folder: str) -> Run:
        bench = self.bench
        return Run(
            bench.storage,
            folder,
            bench.fleet.missions.seed,
            self.workers,
            None if isinstance(self.pretrained, PlannerModel) else self.pretrained,
            version=bench.evaluator.version,
            listener=self.listener,
        )

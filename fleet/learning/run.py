"""What a run of shaping or training is given beside its problem, and what both do alike."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from fleet.errors import ModelError, TrainingError
from fleet.learning.checkpoint import Checkpoint, fingerprint
from fleet.learning.goals import Objective
from fleet.learning.model import SAModel
from fleet.learning.practice import Grounds, visit_everything
from fleet.learning.progress import Listener, nobody
from fleet.spec.resources import Fleet
from fleet.storage.port import Storage

_RELEASE = 2
"""Raised whenever the same problem would give another result: old checkpoints then count for nothing."""


@dataclass(frozen=True)
class Run:
    """How to run.

    Args:
        storage, folder: Where checkpoints are kept.
        seed: Fixes the result.
        workers: Worker processes; the result does not depend on it.
        pretrained: SA to start from; blank when left out.
        version: Anything else that the result depends on, such as the version of Eval().
        listener: Told about progress.
    """

    storage: Storage
    folder: str
    seed: int = 0
    workers: int = 1
    pretrained: SAModel | None = None
    version: str = ""
    listener: Listener = nobody

    def check(self, fleet: Fleet, grounds: Grounds) -> None:
        """Whether the pre-trained model is of the fleet's kind and for the SSV of the contexts.

        Raises:
            ModelError: it is not.
        """
        if self.pretrained is None:
            return
        if self.pretrained.kind is not fleet.sa.kind:
            raise ModelError(
                f"the pre-trained model is of kind {self.pretrained.kind}, but sa.kind is {fleet.sa.kind}; "
                "write the model's kind there, or leave sa.pretrained out"
            )
        if self.pretrained.features != grounds.features:
            raise ModelError(
                f"the pre-trained model expects the features {', '.join(self.pretrained.features)}, but Map() gives "
                f"{', '.join(grounds.features)}; leave sa.pretrained out, or choose the Map() it was trained with"
            )

    def checkpoint(self, name: str, fleet: Fleet, grounds: Grounds, *more: object) -> Checkpoint:
        """The checkpoint of a problem."""
        spec = fleet.model_dump_json(
            include={"agents", "state_space", "goals", "sa", "ha", "reward_shaping", "training"}
        )
        terrains = [
            part
            for terrain in grounds.terrains
            for part in (terrain.environment.digest, terrain.ssv.tobytes(), terrain.layout.parts, terrain.layout.starts)
        ]
        pretrained = self.pretrained.to_bytes() if self.pretrained else b""
        mark = fingerprint(
            _RELEASE, spec, self.seed, self.version, pretrained, grounds.features, grounds.agents, grounds.energy,
            *terrains, *more,
        )  # fmt: skip
        return Checkpoint(self.storage, f"{self.folder}/{name}.json", mark)


def objective_of(fleet: Fleet, contexts: int) -> Objective:
    """The loss of the FleetSpec's goals over so many contexts."""
    shaping = fleet.reward_shaping
    return Objective(fleet.goals, shaping.minimise, shaping.margin, contexts)


def references(
    fleet: Fleet, grounds: Grounds, thorough: Callable[[Grounds], Sequence[Mapping[str, float]]] = visit_everything
) -> tuple[float, ...]:
    """The metric to minimise of a mission that visits everything, for each context; NaN where Eval() gives none.

    Args:
        thorough: Metrics of such a mission over each context.
    Raises:
        TrainingError: Eval() has no metric for a goal even then, so that no mission could meet it.
        FunctionError: Eval() failed.
    """
    missions = thorough(grounds)
    given = {name for metrics in missions for name in metrics}
    absent = sorted({goal.metric for goal in fleet.goals} - given)
    if absent:
        raise TrainingError(
            f"spec.goals asks for {', '.join(absent)}, but Eval() gives no such metric; it gives "
            f"{', '.join(sorted(given)) or 'none'}: correct the goal, or return the metric"
        )
    name = fleet.reward_shaping.minimise
    return tuple(float(metrics.get(name, math.nan)) for metrics in missions)


def total_loss(objective: Objective, missions: Sequence[Mapping[str, float]], reference: Sequence[float]) -> float:
    """Sum of the losses over the contexts."""
    return sum(objective.loss(metrics, scale) for metrics, scale in zip(missions, reference, strict=True))


def shown(fleet: Fleet, metrics: Mapping[str, float]) -> dict[str, float | None]:
    """The metrics that goals and costs speak of; None for those that are no finite number."""
    names = sorted({goal.metric for goal in fleet.goals} | {fleet.reward_shaping.minimise})
    values = {name: metrics.get(name, math.nan) for name in names}
    return {name: float(value) if math.isfinite(value) else None for name, value in values.items()}

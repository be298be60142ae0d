"""Where everything of a fleet is in storage: the one module that knows paths."""

from __future__ import annotations

from dataclasses import dataclass

CLAIMS = "_claims"
"""Folder of the claims of all fleets; no namespace has such a name."""


@dataclass(frozen=True)
class FleetPaths:
    """Paths of one fleet's objects.

    Args:
        namespace, fleet: Names of the FleetSpec.
    """

    namespace: str
    fleet: str

    @property
    def root(self) -> str:
        """Folder of everything."""
        return f"{self.namespace}/{self.fleet}"

    @property
    def fleet_spec(self) -> str:
        """The FleetSpec that the run was started with, as JSON."""
        return f"{self.root}/fleet.json"

    def context(self, name: str) -> str:
        """Folder of a context."""
        return f"{self.root}/contexts/{name}"

    def origin(self, name: str) -> str:
        """What a context in storage is a copy of."""
        return f"{self.context(name)}/origin.json"

    @property
    def functions(self) -> str:
        """The small files that pods are given with their functions, as the FleetSpec in storage was flown with."""
        return f"{self.root}/functions.json"

    @property
    def subsets(self) -> str:
        """The subsets that the user's own aggregation chose; not there for the other kinds."""
        return f"{self.root}/subsets.json"

    @property
    def claim(self) -> str:
        """Whose data it is, and what becomes of it when its FleetSpec is deleted; beside the data of all fleets."""
        return f"{CLAIMS}/{self.namespace}.{self.fleet}.json"

    def mapped(self, context_digest: str, map_version: str) -> str:
        """SSVs of all states of a context: cached by content."""
        return f"{self.root}/mapped/{context_digest}-{map_version}.npz"

    @property
    def shaping(self) -> str:
        """Folder of reward shaping: checkpoints and result."""
        return f"{self.root}/shaping"

    @property
    def reward(self) -> str:
        """The reward model that shaping chose: weights, thresholds, normaliser."""
        return f"{self.root}/models/reward.json"

    @property
    def training(self) -> str:
        """Folder of training: checkpoints and result."""
        return f"{self.root}/training"

    @property
    def initial_model(self) -> str:
        """SA as trained before the first mission: the model of the empty subset."""
        return f"{self.root}/models/initial.npz"

    def mission(self, number: int) -> str:
        """Folder of a mission."""
        return f"{self.root}/missions/{number:04d}"

    def plan(self, number: int) -> str:
        """What every role of a mission needs to know."""
        return f"{self.mission(number)}/plan.json"

    def environment(self, number: int) -> str:
        """Where a mission flies, as its sensors said it; with the truth in replay."""
        return f"{self.mission(number)}/environment.json"

    def log(self, number: int, agent: str) -> str:
        """Records of one agent's mission."""
        return f"{self.mission(number)}/agents/{agent}/log.jsonl"

    def landing(self, number: int, agent: str) -> str:
        """How one agent's mission ended: its metrics, or why it failed."""
        return f"{self.mission(number)}/agents/{agent}/landing.json"

    def evaluation(self, number: int) -> str:
        """Eval() of a whole mission: metrics and goals met."""
        return f"{self.mission(number)}/evaluation.json"

    def artefacts(self, number: int) -> str:
        """Grids that Eval() made of a whole mission."""
        return f"{self.mission(number)}/artefacts.npz"

    def model(self, number: int, subset: str) -> str:
        """SA as retrained after a mission from a subset's records."""
        return f"{self.mission(number)}/models/{subset}.npz"

    def retraining(self, number: int, subset: str) -> str:
        """What the retraining of a subset took."""
        return f"{self.mission(number)}/retraining/{subset}.json"

    def trainer_report(self, number: int) -> str:
        """What the trainer spent: 0 for the training before the first mission, else the weighing after a mission."""
        return f"{self.mission(number)}/weighing.json" if number else f"{self.training}/report.json"

    def weights(self, number: int) -> str:
        """Weights over models that each agent flies mission `number` with, and the models' usefulness."""
        return f"{self.mission(number)}/weights.json"

"""SA of a Planner: what a capture brings, learned from what captures brought.

A capture is worth a weighted sum of what the swarm believed of the cell (`fleet.planning.interest`). The weights that
shaping found are the prior, but for their scale; captures of flown missions, and of simulated ones over the training
contexts, are evidence: the features of each cell before it was captured, and how many cells became right on the map.
The model is the mean of the posterior of a Bayesian linear regression, so a model that has learned from one mission
after the other is the same as one that has learned from both at once.

Source: Bishop 2006, Pattern Recognition and Machine Learning, section 3.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fleet.errors import ModelError
from fleet.learning.archive import Archive, read_archive
from fleet.missions.documents import ModelReference
from fleet.planning.tactics import InterestWeights
from fleet.spec.learning import BELIEVED
from fleet.storage.port import Storage

FORMAT = "fleet-planner/1"
PRIOR_CAPTURES = 2000.0
"""How many captures the prior weighs as much as: what one capture brings is nearly all noise, and a model that has
learned from one field alone is worse than the prior (docs/evaluation.md)."""
_TINY = 1e-12
Values = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Evidence:
    """What captures brought.

    Args:
        features: Of each cell before its capture, float64 [n, len(BELIEVED)].
        gains: Cells of the map that became right by the capture, float64 [n].
    """

    features: Values
    gains: Values

    def __len__(self) -> int:
        return len(self.gains)


@dataclass(frozen=True, eq=False)
class PlannerModel:
    """Weights of the believed features, as far as they are known. A value: an update gives a new model.

    Args:
        features: Names of the features that Map() gives.
        prior: Weights that were shaped, float64 [len(BELIEVED)].
        moments: Sum of the products of the features of captures, float64 [len(BELIEVED), len(BELIEVED)].
        products: Sum of the products of features and gains, float64 [len(BELIEVED)].
        captures: How many captures these are of.
    """

    features: tuple[str, ...]
    prior: Values
    moments: Values
    products: Values
    captures: int = 0

    @staticmethod
    def blank(features: Sequence[str], weights: InterestWeights) -> PlannerModel:
        """A model that knows the prior alone."""
        prior = np.array([getattr(weights, name) for name in BELIEVED])
        count = len(BELIEVED)
        return PlannerModel(tuple(features), prior, np.zeros((count, count)), np.zeros(count))

    @property
    def interest(self) -> InterestWeights:
        """The most probable weights; none is negative, and their sum is 1, as blending is to depend on trust alone."""
        found = self.prior
        if self.captures:
            along = float(self.prior @ self.moments @ self.prior)
            scale = max(0.0, float(self.prior @ self.products)) / along if along else 0.0
            weighed = np.diag(PRIOR_CAPTURES * np.maximum(self.moments.diagonal() / self.captures, _TINY))
            known = self.products + weighed @ (scale * self.prior)
            found = np.asarray(np.linalg.solve(self.moments + weighed, known))
        if not found.max() > 0.0:  # nothing brought anything: there is nothing to tell them apart by
            found = self.prior
        found = np.maximum(found, 0.0)
        found = found / found.sum()
        return InterestWeights(**dict(zip(BELIEVED, found.tolist(), strict=True)))

    def updated(self, evidence: Evidence) -> PlannerModel:
        """A model that has also learned from these captures."""
        features, gains = evidence.features, evidence.gains
        return replace(
            self,
            moments=self.moments + features.T @ features,
            products=self.products + features.T @ gains,
            captures=self.captures + len(evidence),
        )

    def to_bytes(self) -> bytes:
        """The saved model; equal models give equal bytes."""
        arrays = {"prior": self.prior, "moments": self.moments, "products": self.products}
        return Archive(FORMAT, {"features": list(self.features), "captures": self.captures}, arrays).to_bytes()


def load_planner(data: bytes, features: Sequence[str] | None = None) -> PlannerModel:
    """A saved model.

    Args:
        features: Names of the features that Map() gives; None takes any.
    Raises:
        ModelError: the bytes are not whole, or are another kind of model or one for another SSV.
    """
    archive = read_archive(data)
    if archive.format != FORMAT:
        raise ModelError(f"the model has the format {archive.format!r}, and a Planner flies with {FORMAT!r}")
    names = tuple(archive.meta.get("features", ()))
    if features is not None and names != tuple(features):
        raise ModelError(
            f"the model expects the features {', '.join(names)}, but Map() gives {', '.join(features)}; "
            "train it anew or choose the Map() that it was trained with"
        )
    count = len(BELIEVED)
    return PlannerModel(
        features=names,
        prior=archive.array("prior", (count,)),
        moments=archive.array("moments", (count, count)),
        products=archive.array("products", (count,)),
        captures=int(archive.meta.get("captures", 0)),
    )


def load_planners(storage: Storage, references: Sequence[ModelReference]) -> dict[str, PlannerModel]:
    """Saved models by key; errors as of `load_planner`."""
    return {each.key: load_planner(storage.read(each.path)) for each in references}


def blended(models: Mapping[str, PlannerModel], weights: Mapping[str, float]) -> InterestWeights:
    """What several models say together: the mean of their weights, by how much each is trusted.

    Args:
        weights: Of each model key; not negative, sum 1.
    Raises:
        ModelError: a model that has a weight is not there.
    """
    missing = sorted(key for key, weight in weights.items() if weight > 0 and key not in models)
    if missing:
        raise ModelError(f"weights are given to models that are not there: {', '.join(missing)}")
    trusted = {key: models[key].interest for key in sorted(weights) if weights[key] > 0}
    means = {name: sum(weights[key] * getattr(each, name) for key, each in trusted.items()) for name in BELIEVED}
    return InterestWeights(**means)

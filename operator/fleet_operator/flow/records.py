"""What a fleet has in storage: one listing, and documents that are read when they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, MutableMapping
from dataclasses import dataclass, field
from typing import TypeVar

from pydantic import ValidationError

from fleet.errors import StorageError
from fleet.missions.documents import Landing, MissionEvaluation, WeightsDocument
from fleet.spec.base import Model
from fleet.spec.resources import Fleet
from fleet.storage.layout import FleetPaths
from fleet.storage.port import Storage
from fleet_operator.policy.lifecycle import Progress
from fleet_operator.policy.progress import is_trained, missions_so_far

_Document = TypeVar("_Document", bound=Model)


@dataclass(frozen=True)
class FleetRecords:
    """What is there of a fleet.

    Args:
        sizes: Bytes of everything that is in storage under the fleet's folder, by path.
        kept: Documents that were read before, by path: once written, they stay as they are.
    """

    storage: Storage
    paths: FleetPaths
    sizes: Mapping[str, int]
    kept: MutableMapping[str, Model] = field(default_factory=dict)

    @property
    def objects(self) -> Collection[str]:
        """Paths of everything that is there."""
        return self.sizes.keys()

    def evaluation(self, number: int) -> MissionEvaluation | None:
        """Evaluation of a mission; None when it is not over."""
        return self._document(self.paths.evaluation(number), MissionEvaluation)

    def weights(self, number: int) -> WeightsDocument | None:
        """Weights that a mission flies with; None when they are not known yet."""
        return self._document(self.paths.weights(number), WeightsDocument)

    def landing(self, number: int, agent: str) -> Landing | None:
        """How an agent's mission ended; None when it has not."""
        return self._document(self.paths.landing(number, agent), Landing)

    def history(self, number: int, fleet: Fleet) -> dict[int, WeightsDocument]:
        """The weights of missions 1..number; without pruning, only those of `number` are wanted."""
        first = 1 if fleet.aggregation.pruning.below > 0 else number
        found = {each: self.weights(each) for each in range(first, number + 1)}
        return {each: document for each, document in found.items() if document is not None}

    def progress(self, fleet: Fleet, due: Callable[[int], frozenset[str]], broken: str = "") -> Progress:
        """What the fleet has reached.

        Args:
            due: Subsets whose aggregators are to run after a mission; asked for missions that are not weighed only.
            broken: Why the fleet cannot go on; "" when it can.
        """

        def weighed(number: int) -> bool:
            return self.paths.weights(number + 1) in self.objects

        def failed(number: int) -> frozenset[str]:
            evaluation = None if weighed(number) else self.evaluation(number)
            return frozenset() if evaluation is None else frozenset(evaluation.failures)

        return Progress(
            prepared=self.paths.fleet_spec in self.objects,
            trained=is_trained(self.paths, self.objects),
            missions=missions_so_far(
                self.paths,
                self.objects,
                [agent.name for agent in fleet.agents.resolved],
                lambda number: frozenset() if weighed(number) else due(number),
                failed,
            ),
            broken=broken,
        )

    def _document(self, path: str, kind: type[_Document]) -> _Document | None:
        if path not in self.objects:
            return None
        kept = self.kept.get(path)
        if isinstance(kept, kind):
            return kept
        try:
            document = kind.model_validate_json(self.storage.read(path))
        except ValidationError as error:
            told = " ".join(str(error.errors(include_url=False)[0]["msg"]).split())
            raise StorageError(f"{path} in {self.storage.uri} is damaged: {told}; restore it, or delete it") from error
        self.kept[path] = document
        return document


def read_records(storage: Storage, paths: FleetPaths, kept: MutableMapping[str, Model] | None = None) -> FleetRecords:
    """List a fleet's folder. Raises StorageError."""
    sizes = {entry.path: entry.size_bytes for entry in storage.list(paths.root)}
    return FleetRecords(storage, paths, sizes, {} if kept is None else kept)

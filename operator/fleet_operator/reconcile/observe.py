"""What there is of a fleet, in the cluster and in storage, and which FleetSpec counts now."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

from fleet.aggregation.subsets import Subset, known_subsets
from fleet.errors import StorageError
from fleet.spec.resources import Fleet, FleetSpec
from fleet.storage.layout import FleetPaths
from fleet.storage.port import Storage
from fleet_operator.compiler.bundle import Bundle
from fleet_operator.compiler.settings import Settings
from fleet_operator.compiler.target import AggregatorTerms, Owner, Target
from fleet_operator.flow.files import outside
from fleet_operator.flow.orders import aggregator_terms
from fleet_operator.flow.records import FleetRecords
from fleet_operator.flow.stored import Flown, kept_form, read_functions, read_spec, renewed
from fleet_operator.policy.progress import is_trained
from fleet_operator.reconcile.asked import Asked
from fleet_operator.reconcile.listing import last_ordered, whole
from fleet_operator.reconcile.listing import renewed as renewed_listing
from fleet_operator.reconcile.note import Note
from fleet_operator.reconcile.seen import Seen
from fleet_operator.resources import names
from fleet_operator.resources.refs import FLEET_SPEC
from fleet_operator.resources.views import JobState


@dataclass(frozen=True)
class Observed:
    """Everything that a decision rests on.

    Args:
        asked: What the user asks for now.
        storage: Where the fleet's data is.
        stored: The FleetSpec in storage; None when there is none.
        functions: The functions in storage; None when there are none.
        subsets: The subsets of the FleetSpec that counts; None when they are not known yet.
    """

    seen: Seen
    asked: Asked
    settings: Settings
    storage: Storage
    records: FleetRecords
    stored: FleetSpec | None
    functions: Bundle | None
    subsets: tuple[Subset, ...] | None
    flown: Flown | None

    @property
    def paths(self) -> FleetPaths:
        """Where the fleet's objects are in storage."""
        return self.records.paths

    @property
    def fleet(self) -> Fleet | None:
        """The fleet as it is flown; None when there is nothing to fly."""
        return None if self.flown is None else self.flown.fleet

    @cached_property
    def agents(self) -> tuple[str, ...]:
        """Names of the agents."""
        return () if self.flown is None else tuple(agent.name for agent in self.flown.fleet.agents.resolved)

    @cached_property
    def target(self) -> Target:
        """The fleet as it is flown, for the compiler."""
        if self.flown is None:
            raise ValueError("a fleet that is refused has nothing to compile")
        owner = Owner(FLEET_SPEC.api_version, FLEET_SPEC.kind, self.seen.ref.name, self.seen.uid)
        return Target(self.flown.spec, self.flown.bundle, self.settings, self.storage.uri, owner)

    @cached_property
    def order(self) -> str:
        """Hash of what the pods of this fleet do; see `names.ORDER_ANNOTATION`."""
        if self.flown is None:
            return ""
        installed = (self.settings.runtime_image, self.settings.role_command, self.settings.pull_policy)
        return hashlib.blake2b(repr((self.flown.digest, installed)).encode(), digest_size=8).hexdigest()

    @property
    def is_current(self) -> bool:
        """Whether the FleetSpec in storage is the one that is asked for."""
        return self.asked.flown is not None and self.stored == kept_form(self.asked.flown, self.stored)

    @property
    def has_changed(self) -> bool:
        """Whether something else is asked for than what is in storage."""
        if self.asked.flown is None or self.stored is None:
            return False
        return self.asked.flown.digest != Flown(self.stored, self.functions or self.asked.flown.bundle).digest

    def terms(self, number: int) -> tuple[AggregatorTerms, ...]:
        """Level and share of each aggregator after a mission; none when its weights or the subsets are not known."""
        if self.flown is None or self.subsets is None or self.records.weights(number) is None:
            return ()
        history = self.records.history(number, self.flown.fleet)
        keys = [subset.key for subset in self.subsets]
        return aggregator_terms(self.flown.fleet, history, number, self.seen.room, keys)


def observe(seen: Seen, asked: Asked, settings: Settings, storage: Storage, note: Note) -> Observed:
    """Look at a fleet's storage: a listing, and the documents that are not known yet.

    Raises:
        StorageError: it cannot be looked at.
    """
    paths = FleetPaths(seen.ref.namespace, seen.ref.name)
    known = note.known if note.known_for == seen.asked_for else None
    note.known = whole(storage, paths) if known is None else renewed_listing(storage, paths, known)
    note.known_for = seen.asked_for
    records = FleetRecords(storage, paths, note.known, note.documents)
    note.tidy()
    if paths.fleet_spec not in records.objects:
        note.stored, note.functions = None, None
    elif note.stored is None:
        note.stored = read_spec(storage, paths)
        note.functions = None if note.stored is None else read_functions(storage, paths, note.stored)
    flown = _flown(seen, asked, records, note)
    subsets = None if flown is None else known_subsets(flown.fleet, storage, paths)
    return Observed(seen, asked, settings, storage, records, note.stored, note.functions, subsets, flown)


def mission_under_way(records: FleetRecords) -> int:
    """The mission that was ordered and is not weighed; 0 when there is none."""
    number = last_ordered(records.sizes, records.paths)
    return number if number and records.paths.weights(number + 1) not in records.objects else 0


def _flown(seen: Seen, asked: Asked, records: FleetRecords, note: Note) -> Flown | None:
    """Which FleetSpec counts: that of the order for what was ordered, that of the cluster for all that comes."""
    if note.stored is None or not _is_bound(seen, records):
        return asked.flown
    bundle = note.functions
    if bundle is None:  # `fleet run` began it, and keeps no functions
        bundle = asked.flown.bundle if asked.flown is not None else Bundle()
    problems = outside(note.stored)
    if problems:
        told = f"{records.paths.fleet_spec} in {records.storage.uri} names files that are none of the fleet's"
        raise StorageError(f"{told}: {problems[0]}; restore it, or delete it")
    spec = note.stored if asked.flown is None else renewed(note.stored, asked.flown.spec)
    return Flown(spec, bundle)


def _is_bound(seen: Seen, records: FleetRecords) -> bool:
    """Whether something runs that was begun with the FleetSpec in storage."""
    if mission_under_way(records):
        return True
    training = seen.state(names.training_job(seen.ref.name))
    return not is_trained(records.paths, records.objects) and training is JobState.RUNNING

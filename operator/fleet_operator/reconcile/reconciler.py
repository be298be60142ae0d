"""The operator's heart: one pass brings one fleet one step on.

    see -> examine -> observe -> decide -> write storage -> apply -> tell

A pass starts from what there is, not from what an event said. It may be broken off at any call; the next one then
finds what is done, does the rest, and comes to the same end.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Mapping
from dataclasses import replace

from fleet.errors import SpecError, StorageError
from fleet.storage.port import Storage
from fleet_operator.cluster.errors import ClusterError, Forbidden, Invalid
from fleet_operator.policy.lifecycle import Fly, Order, Prepare, Retrain, Train, Wait, Weigh
from fleet_operator.policy.status import Situation, Trouble
from fleet_operator.policy.times import rfc3339
from fleet_operator.policy.troubles import of_rejection, of_storage
from fleet_operator.reconcile import leaving, ordering
from fleet_operator.reconcile.apply import Applied, FleetGone, apply
from fleet_operator.reconcile.asked import Asked, examine
from fleet_operator.reconcile.claiming import possess
from fleet_operator.reconcile.copies import FEWER_COPIES, Copies
from fleet_operator.reconcile.decide import Again, Decided, decide
from fleet_operator.reconcile.desire import desire
from fleet_operator.reconcile.diagnose import Diagnoser
from fleet_operator.reconcile.means import Means
from fleet_operator.reconcile.note import Note
from fleet_operator.reconcile.observe import observe
from fleet_operator.reconcile.placing import placements
from fleet_operator.reconcile.resizing import resize_running
from fleet_operator.reconcile.seen import Seen, take
from fleet_operator.reconcile.tell import (
    mission_situations,
    said_to_be_at_rest,
    situation_of,
    tell_fleet,
    tell_missions,
    unobserved,
)
from fleet_operator.resources.refs import JOB, Manifest, ObjectRef

_SOON_S = 1.0
_FLIGHT_S = 5.0
_WORK_S = 15.0
_STORAGE_RETRY_S, _STORAGE_LONGEST_S = 10.0, 300.0
_REFUSED_S = 60.0
_LEAST_WAIT_S = 0.1
_LONG_S = 60.0
_MOST_STEPS = 6
"""Steps that one pass takes when each is done at once."""
_OTHER_OWNER = "Only one reference can have Controller set to true"
"""The API server's words when an object of an earlier FleetSpec is still there, which the watches do not see."""


class FleetReconciler:
    """Brings fleets on; one pass of a fleet at a time.

    Args:
        means: What it works with.
    """

    def __init__(self, means: Means) -> None:
        self._means, self._cluster = means, means.cluster
        self._diagnoser = Diagnoser(means.cluster)
        self._notes: dict[ObjectRef, Note] = {}
        self._copies = Copies()

    async def reconcile(self, ref: ObjectRef) -> float | None:
        """Bring a fleet on.

        Returns:
            Seconds after which to look again without an event; None when only an event can change anything.

        Raises:
            ClusterError: the API server refuses; the pass is to be tried again.
        """
        seen = take(self._cluster, ref)
        if seen is None:
            self._notes.pop(ref, None)
            return None
        note = self._note(seen)
        if note.at_rest and note.at_rest == seen.fingerprint:
            return None
        try:
            later = await self._pass(seen, note)
        except FleetGone:
            return None
        except (StorageError, SpecError) as error:
            return await self._without_storage(seen, note, error)
        except (Forbidden, Invalid) as error:
            if _OTHER_OWNER in str(error):
                return _SOON_S
            with contextlib.suppress(ClusterError):  # the first error is the one that counts
                await self._tell_rejection(seen, note, error)
            raise
        note.without_storage_s = None
        return later

    async def forget(self, ref: ObjectRef, last: Manifest | None) -> None:
        """A FleetSpec is gone: do with its data what it asked for.

        Args:
            last: The FleetSpec as it was last seen, if it was.

        Raises:
            StorageError: to be tried again; the sweep at the next start finds it too.
        """
        self._notes.pop(ref, None)
        await leaving.forget(self._means, ref, last)

    async def sweep(self, alive: Mapping[ObjectRef, str]) -> None:
        """Do the same for all FleetSpecs that went while nobody looked.

        Args:
            alive: The uid of every FleetSpec of the cluster.

        Raises:
            StorageError: to be tried again.
        """
        await leaving.sweep(self._means, alive)

    async def _pass(self, seen: Seen, note: Note) -> float | None:
        if seen.strangers:
            return await self._await_strangers(seen)
        asked = await self._asked(seen, note)
        for _ in range(_MOST_STEPS):
            possession = await possess(self._means, seen, asked, note)
            asked, storage = possession.asked, possession.storage
            if storage is None:
                return await self._tell_refusal(seen, asked, note)
            decided = await asyncio.to_thread(self._decide, seen, asked, storage, note)
            observed = decided.observed
            await self._look_at_copies(decided, note)
            if await ordering.land(self._means, decided):
                continue
            match decided.step:
                case Prepare():
                    asked = await ordering.prepare(self._means, observed, note)
                case Order(number=number):
                    await self._tell_missions(decided, note)
                    asked = await ordering.order(self._means, observed, number, note)
                case _:
                    return await self._work(decided, note)
        return _SOON_S

    def _decide(self, seen: Seen, asked: Asked, storage: Storage, note: Note) -> Decided:
        return decide(observe(seen, asked, self._means.settings, storage, note), self._means.clock.now())

    async def _look_at_copies(self, decided: Decided, note: Note) -> None:
        """Say it when the fleet's storage keeps fewer copies than it is asked for."""
        observed = decided.observed
        if note.copies_seen or observed.flown is None:
            return
        storage = self._means.storage(observed.target.storage)
        complaint = await self._copies.complaint(storage, self._means.clock.now())
        if complaint:
            await self._cluster.record(observed.seen.body, "Warning", FEWER_COPIES, complaint)
        note.copies_seen = complaint is not None

    async def _asked(self, seen: Seen, note: Note) -> Asked:
        """Examine the FleetSpec, unless it is the one that was examined last."""
        if note.asked is None or note.asked_for != seen.asked_for:
            note.asked = await asyncio.to_thread(examine, seen.body, self._means.shelf(seen), self._means.settings)
            note.asked_for = seen.asked_for
        return note.asked

    async def _work(self, decided: Decided, note: Note) -> float | None:
        """Have the cluster as the step wants it, look after what fails, and say how things are."""
        seen, step = decided.observed.seen, decided.step
        if decided.again is not Again.NOTHING:
            await ordering.start_over(self._means, decided, note)
            return _SOON_S
        placed = await asyncio.to_thread(placements, decided, step.number) if isinstance(step, Retrain) else {}
        applied = await apply(self._cluster, desire(decided, placed))
        if isinstance(step, Retrain):
            await resize_running(self._cluster, decided, step.number, note)
        diagnosis = await self._diagnoser.diagnose(decided, note, self._means.clock.now())
        for job in diagnosis.lost:
            await self._cluster.delete(JOB, job.ref, job.uid)
        await self._tell(decided, note, diagnosis.troubles)
        if diagnosis.lost:
            return _SOON_S
        later = self._look_again_s(decided, applied, note)
        now = take(self._cluster, seen.ref)
        if later is None and now is not None and now.fingerprint == seen.fingerprint:
            note.rest(seen.fingerprint)
        elif isinstance(step, Wait) and step.seconds >= _LONG_S:
            note.ease()
        return later

    def _look_again_s(self, decided: Decided, applied: Applied, note: Note) -> float | None:
        """When to look again without an event."""
        if applied.waits or decided.plan.fallen:
            return _SOON_S
        match decided.step:
            case Fly():
                return _FLIGHT_S
            case Train() | Retrain() | Weigh():
                return _WORK_S
            case Wait(seconds=seconds):
                return max(seconds, _LEAST_WAIT_S)
            case None if decided.observed.asked is not note.asked:  # a storage refused it, which sends no event
                return _REFUSED_S
            case _:
                return None

    async def _tell(self, decided: Decided, note: Note, troubles: tuple[Trouble, ...]) -> None:
        now_s = self._means.clock.now()
        await self._tell_missions(decided, note)
        note.situation = await asyncio.to_thread(situation_of, decided, troubles, now_s)
        await tell_fleet(self._cluster, decided.observed.seen, note.situation)

    async def _tell_missions(self, decided: Decided, note: Note) -> None:
        situations = await asyncio.to_thread(mission_situations, decided, note, self._means.clock.now())
        await tell_missions(self._cluster, decided.observed.seen, situations)

    async def _tell_refusal(self, seen: Seen, asked: Asked, note: Note) -> float | None:
        """A FleetSpec that is refused, and has nothing in storage."""
        note.situation = self._blank(seen, asked.refusal)
        await tell_fleet(self._cluster, seen, note.situation)
        if asked is not note.asked:
            return _REFUSED_S
        note.rest(seen.fingerprint)
        return None

    async def _await_strangers(self, seen: Seen) -> float:
        """Objects of an earlier FleetSpec have the names of ours: they go with their owner, which takes a moment."""
        for each in seen.strangers:
            if not each.deleting:
                await self._cluster.delete(each.kind, each.ref, each.uid)
        await tell_fleet(self._cluster, seen, self._blank(seen, None))
        return _SOON_S

    async def _without_storage(self, seen: Seen, note: Note, error: StorageError | SpecError) -> float:
        """Say it, keep all else as it was, and try again: the longer it lasts, the later.

        A look at a storage that does not answer holds a worker, and a thousand fleets may name such storages.
        """
        await self._tell_trouble(seen, note, of_storage(error))
        now_s = self._means.clock.now()
        if note.without_storage_s is None:
            note.without_storage_s = now_s
        return min(max(now_s - note.without_storage_s, _STORAGE_RETRY_S), _STORAGE_LONGEST_S)

    async def _tell_rejection(self, seen: Seen, note: Note, error: ClusterError) -> None:
        """What the API server refuses, only the user or the administrator can do something about."""
        await self._tell_trouble(seen, note, of_rejection(str(error)))

    async def _tell_trouble(self, seen: Seen, note: Note, trouble: Trouble) -> None:
        before = note.situation
        if before is None or (before.refusal is not None and before.generation != seen.generation):
            before = self._blank(seen, note.refusal(seen.asked_for))
        now = rfc3339(self._means.clock.now())
        situation = replace(before, generation=seen.generation, troubles=(trouble,), now=now)
        await tell_fleet(self._cluster, seen, situation)

    def _blank(self, seen: Seen, refusal: Trouble | None) -> Situation:
        """What is said when nothing could be observed."""
        return unobserved(seen.generation, refusal, self._means.clock.now())

    def _note(self, seen: Seen) -> Note:
        note = self._notes.get(seen.ref)
        if note is None or note.uid != seen.uid:
            note = self._notes[seen.ref] = Note(seen.uid)
            if said_to_be_at_rest(seen):
                note.rest(seen.fingerprint)
        return note

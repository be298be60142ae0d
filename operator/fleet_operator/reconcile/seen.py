"""The cluster as a pass finds it: taken once, from the memory of the watches, before storage is looked at.

This order counts: a role writes before it ends. So what a Job that is over has written is there to be seen, and a Job
that is over without its output has failed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from fleet_operator.cluster.port import Cluster
from fleet_operator.flow.files import version_of
from fleet_operator.flow.orders import Room
from fleet_operator.resources.applied import mark_of
from fleet_operator.resources.refs import FLEET_SPEC, JOB, MISSION, Kind, Manifest, ObjectRef
from fleet_operator.resources.views import JobState, JobView, NodeView


@dataclass(frozen=True)
class Stranger:
    """An object with a name that ours will have, of an owner that is gone."""

    kind: Kind
    ref: ObjectRef
    uid: str
    deleting: bool


@dataclass(frozen=True)
class Seen:
    """What the watches know of one fleet.

    Args:
        body: The FleetSpec.
        jobs: Its Jobs by name.
        strangers: Jobs and Missions of an earlier FleetSpec of this name, which are not gone yet.
        missions: Its Mission objects by number.
        files: ConfigMaps with its files.
        nodes: All machines.
    """

    ref: ObjectRef
    body: Manifest
    jobs: Mapping[str, JobView]
    strangers: tuple[Stranger, ...]
    missions: Mapping[int, Manifest]
    files: tuple[Manifest, ...]
    nodes: tuple[NodeView, ...]

    @property
    def uid(self) -> str:
        """Of the FleetSpec."""
        return str(self.body["metadata"].get("uid", ""))

    @property
    def generation(self) -> int:
        """Of the FleetSpec."""
        return int(self.body["metadata"].get("generation", 0))

    @cached_property
    def asked_for(self) -> str:
        """Changes whenever the user may ask for something else."""
        return f"{self.uid}/{self.generation}/{version_of(self.files)}"

    @cached_property
    def fingerprint(self) -> str:
        """Changes whenever something may be left to do for a fleet at rest."""
        jobs = [(job.ref.name, job.uid, job.state, job.deleting) for job in self.jobs.values()]
        text = repr((self.asked_for, jobs, len(self.strangers), sorted(self.missions)))
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()

    def state(self, job: str) -> JobState | None:
        """How far a Job is; None when there is none."""
        view = self.jobs.get(job)
        return None if view is None else view.state

    @cached_property
    def room(self) -> Room:
        """What machines have for aggregators: all that are ready and take pods."""
        return Room.of(self.nodes)


def take(cluster: Cluster, ref: ObjectRef) -> Seen | None:
    """What the watches know now; None when the FleetSpec is gone, or on its way."""
    body = cluster.fleet(ref)
    if body is None or is_deleting(body):
        return None
    uid = body["metadata"].get("uid", "")
    jobs, missions = cluster.jobs(ref), cluster.missions(ref)
    strangers = [
        Stranger(JOB, job.ref, job.uid, job.deleting) for job in jobs if job.owner_uid and job.owner_uid != uid
    ]
    strangers += [
        Stranger(MISSION, ObjectRef.of(each), each["metadata"].get("uid", ""), is_deleting(each))
        for each in missions.values()
        if _owner_of(each) not in ("", uid)
    ]
    return Seen(
        ref,
        body,
        {job.ref.name: job for job in jobs if job.owner_uid == uid or _is_left_to_us(job)},
        tuple(strangers),
        {number: each for number, each in missions.items() if _owner_of(each) == uid or _is_orphan(each)},
        cluster.files(ref),
        cluster.nodes(),
    )


def _is_left_to_us(job: JobView) -> bool:
    """A Job that no FleetSpec owns, and that this operator has made: `kubectl delete --cascade=orphan` leaves such.

    Anybody may give a Job of his own the fleet's label; it is not to be touched.
    """
    return not job.owner_uid and bool(job.applied) and job.role is not None


def _is_orphan(mission: Manifest) -> bool:
    return not _owner_of(mission) and bool(mark_of(mission))


def is_deleting(body: Mapping[str, Any]) -> bool:
    """Whether an object is on its way out."""
    return "deletionTimestamp" in body["metadata"]


def _owner_of(body: Mapping[str, Any]) -> str:
    owners = body["metadata"].get("ownerReferences", ())
    return next((str(owner["uid"]) for owner in owners if owner.get("kind") == FLEET_SPEC.kind), "")

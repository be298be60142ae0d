"""Making the cluster as a step wants it; what is so already is left alone, and costs no call."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Iterable
from dataclasses import dataclass
from typing import TypeVar

from fleet_operator.cluster.port import Cluster
from fleet_operator.reconcile.desire import Desired, WantedJob
from fleet_operator.reconcile.seen import is_deleting
from fleet_operator.resources import names
from fleet_operator.resources.refs import JOB, Manifest
from fleet_operator.resources.roles import Role
from fleet_operator.resources.views import JobState, JobView

_Answer = TypeVar("_Answer")
_NEVER_RAN = (JobState.PENDING, JobState.SUSPENDED)


@dataclass(frozen=True)
class Applied:
    """What came of it.

    Args:
        desired: What was wanted.
        waits: Whether something must be gone before the rest can be done.
    """

    desired: Desired
    waits: bool = False


class FleetGone(Exception):
    """The FleetSpec was deleted while a pass was at work: nothing is made any more."""


async def apply(cluster: Cluster, desired: Desired) -> Applied:
    """Remove what is not wanted, then have what is wanted.

    Raises:
        FleetGone: the FleetSpec is no longer there.
        ClusterError: the API server refuses.
    """
    for unwanted in desired.unwanted_waves:
        await together([cluster.delete(each.kind, each.ref, each.uid) for each in unwanted])
    await together([_have(cluster, desired, manifest) for manifest in desired.objects])
    waits = False
    for wave in desired.waves:
        waits |= any(await together([_have_job(cluster, desired, wanted) for wanted in wave]))
    return Applied(desired, waits or bool(desired.decided.plan.stopped))


async def together(calls: Iterable[Awaitable[_Answer]]) -> list[_Answer]:
    """Make calls side by side and wait for all of them; then raise the first error, if there was one."""
    answers = await asyncio.gather(*calls, return_exceptions=True)
    for answer in answers:
        if isinstance(answer, BaseException):
            raise answer
    return [answer for answer in answers if not isinstance(answer, BaseException)]


async def _have(cluster: Cluster, desired: Desired, manifest: Manifest) -> None:
    """Have an object, unless the FleetSpec of this pass is no longer there."""
    seen = desired.decided.observed.seen
    body = cluster.fleet(seen.ref)
    if body is None or is_deleting(body) or body["metadata"].get("uid", "") != seen.uid:
        raise FleetGone(str(seen.ref))
    await cluster.apply(manifest)


async def _have_job(cluster: Cluster, desired: Desired, wanted: WantedJob) -> bool:
    """Have a Job; True when an old one must be gone first."""
    observed = desired.decided.observed
    there = observed.seen.jobs.get(wanted.name)
    if there is None:
        await _have(cluster, desired, _ordered(wanted.compiled(), observed.order))
        return False
    if there.deleting:
        return True
    if there.order != observed.order and is_replaceable(there):
        await cluster.delete(JOB, there.ref, there.uid)
        return True
    return False


def is_replaceable(job: JobView) -> bool:
    """Whether a Job that was made for another order may be made anew: nothing of it runs.

    Of those that are over, only a trainer's is asked for again: agents and aggregators are given up instead.
    """
    return job.state in _NEVER_RAN or (job.state.over and job.role is Role.TRAINER)


def _ordered(manifest: Manifest, order: str) -> Manifest:
    metadata = manifest["metadata"]
    annotations = {**metadata.get("annotations", {}), names.ORDER_ANNOTATION: order}
    return {**manifest, "metadata": {**metadata, "annotations": annotations}}

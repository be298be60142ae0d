"""What becomes of a fleet's data when its FleetSpec is gone."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from fleet.spec.platform import DeletionPolicy
from fleet.storage.layout import FleetPaths
from fleet_operator.flow.claims import Claim, abandoned, all_claims, read_claim, settle
from fleet_operator.reconcile.means import Means
from fleet_operator.resources.refs import Manifest, ObjectRef

_LOOK_S = 0.5
_PATIENCE_S = 30.0
"""Pods end within their grace period; those of a machine that is gone are not waited for."""


async def forget(means: Means, ref: ObjectRef, last: Manifest | None) -> None:
    """Settle the claim of a FleetSpec that is gone; nothing happens when it has none, or when it is there again.

    Raises:
        StorageError, ClusterError: to be tried again.
    """
    claim = await asyncio.to_thread(read_claim, means.platform, FleetPaths(ref.namespace, ref.name))
    gone = "" if last is None else last["metadata"].get("uid", "")
    if claim is None or (gone and claim.uid != gone):
        return
    body = means.cluster.fleet(ref)
    if body is None or body["metadata"].get("uid") != claim.uid:
        await _settle(means, ref, claim)


async def sweep(means: Means, alive: Mapping[ObjectRef, str]) -> None:
    """Settle every claim whose FleetSpec is gone.

    Args:
        alive: The uid of every FleetSpec.

    Raises:
        StorageError, ClusterError: to be tried again.
    """
    # In this order: a FleetSpec that claims its data between the two is among the living.
    claims = await asyncio.to_thread(all_claims, means.platform)
    owners = {(ref.namespace, ref.name): uid for ref, uid in alive.items()}
    for claim in abandoned(claims, owners):
        if means.namespaces and claim.namespace not in means.namespaces:
            continue  # another operator's, which shares the storage
        await _settle(means, ObjectRef(claim.namespace, claim.fleet), claim)


async def _settle(means: Means, ref: ObjectRef, claim: Claim) -> None:
    if claim.on_delete is DeletionPolicy.DELETE:
        await _await_pods(means, ref, claim.uid)
    await asyncio.to_thread(settle, claim, means.platform, means.storage(claim.uri))


async def _await_pods(means: Means, ref: ObjectRef, uid: str) -> None:
    """Wait until nobody writes any more: a log that is written after its folder was deleted would stay for ever."""
    for _ in range(int(_PATIENCE_S / _LOOK_S)):
        jobs = [job for job in means.cluster.jobs(ref) if job.owner_uid == uid]
        if not jobs and not [pod for pod in await means.cluster.pods(ref) if pod.phase in ("Pending", "Running")]:
            return
        await asyncio.sleep(_LOOK_S)

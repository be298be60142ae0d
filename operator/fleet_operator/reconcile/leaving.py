"""What becomes of a fleet's data when its FleetSpec is gone."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping

from fleet.errors import FleetError
from fleet.spec.platform import DeletionPolicy
from fleet.storage.layout import FleetPaths
from fleet_operator.flow.claims import Claim, all_claims, read_claim, settle, write_claim
from fleet_operator.reconcile.means import Means
from fleet_operator.resources.refs import Manifest, ObjectRef

log = logging.getLogger(__name__)

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
    # A uid is of one FleetSpec in all the world: who has seen it go may settle a claim that does not say whose it is.
    if claim is not None and (claim.uid == gone if gone else means.is_ours(claim)):
        await _settle(means, ref, claim)


async def sweep(means: Means, alive: Mapping[ObjectRef, str]) -> None:
    """Settle every claim of this installation whose FleetSpec is gone; one that cannot be settled holds up no other.

    Claims of FleetSpecs that are there, and do not say so, become this installation's. All others are left alone:
    their FleetSpecs may well be in another cluster.

    Args:
        alive: The uid of every FleetSpec.

    Raises:
        StorageError: the claims cannot be listed.
    """
    # In this order: a FleetSpec that claims its data between the two is among the living.
    claims = await asyncio.to_thread(all_claims, means.platform)
    owners, others = dict(alive), 0
    for claim in claims:
        ref = ObjectRef(claim.namespace, claim.fleet)
        if means.namespaces and claim.namespace not in means.namespaces:
            continue  # another operator's, which shares the storage
        is_alive, mine = owners.get(ref) == claim.uid, means.is_ours(claim)
        try:
            if is_alive and not mine:
                await _make_ours(means, ref, claim)
            elif mine and not is_alive:
                await _settle(means, ref, claim)
        except FleetError as error:
            log.warning("%s is gone, and its data cannot be seen to yet: %s", ref, error)
        others += not (is_alive or mine)
    if others:
        log.info("%d claims to data are of FleetSpecs of other installations, or of nobody knows which", others)


async def _settle(means: Means, ref: ObjectRef, claim: Claim) -> None:
    """Do what an abandoned claim says, unless it is another one by now, or its FleetSpec is there."""
    if claim.on_delete is DeletionPolicy.DELETE:
        await _await_pods(means, ref, claim.uid)
    async with means.lock(ref):
        there = await asyncio.to_thread(read_claim, means.platform, claim.paths)
        if there is None or there.uid != claim.uid or _is_there(means, ref, claim.uid):
            return
        await asyncio.to_thread(settle, there, means.platform, means.storage(there.uri))


async def _make_ours(means: Means, ref: ObjectRef, claim: Claim) -> None:
    """Say whose a claim is that was made before claims said so, or before the installation was made anew."""
    async with means.lock(ref):
        there = await asyncio.to_thread(read_claim, means.platform, claim.paths)
        if there == claim and _is_there(means, ref, claim.uid):
            named = claim.model_copy(update={"installation": means.installation()})
            await asyncio.to_thread(write_claim, means.platform, named)


def _is_there(means: Means, ref: ObjectRef, uid: str) -> bool:
    body = means.cluster.fleet(ref)
    return body is not None and body["metadata"].get("uid") == uid


async def _await_pods(means: Means, ref: ObjectRef, uid: str) -> None:
    """Wait until nobody writes any more: a log that is written after its folder was deleted would stay for ever."""
    for _ in range(int(_PATIENCE_S / _LOOK_S)):
        jobs = [job for job in means.cluster.jobs(ref) if job.owner_uid == uid]
        if not jobs and not [pod for pod in await means.cluster.pods(ref) if pod.phase in ("Pending", "Running")]:
            return
        await asyncio.sleep(_LOOK_S)

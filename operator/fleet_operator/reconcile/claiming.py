"""Taking possession of a fleet's folder in storage: a new one, one's own, or what an earlier FleetSpec left."""

from __future__ import annotations

import asyncio
import hashlib
from dataclasses import dataclass

from fleet.errors import SpecError
from fleet.spec.resources import Fleet, FleetSpec
from fleet.storage.layout import FleetPaths
from fleet.storage.port import Storage
from fleet_operator.flow.claims import Claim, read_claim, settle, write_claim
from fleet_operator.flow.stored import read_spec
from fleet_operator.policy.status import Trouble
from fleet_operator.reconcile.asked import INVALID, STORAGE_TAKEN, Asked, refused
from fleet_operator.reconcile.means import Means
from fleet_operator.reconcile.note import Note
from fleet_operator.reconcile.seen import Seen

_FIXED = ("agents", "state groups", "SA kind")


@dataclass(frozen=True)
class Possession:
    """A fleet's folder.

    Args:
        storage: Where it is; None when this FleetSpec has none.
        asked: What is asked for; a refusal when the folder is another's.
    """

    storage: Storage | None
    asked: Asked


async def possess(means: Means, seen: Seen, asked: Asked, note: Note) -> Possession:
    """Take possession, or go on in it: what is known to be claimed costs nothing.

    Raises:
        StorageError: a storage refuses.
    """
    if asked.flown is None:
        return await _own(means, seen, asked)
    spec = asked.flown.spec
    try:
        storage = means.storage(spec.spec.storage.uri or means.settings.storage_uri)
    except SpecError as error:
        return Possession(None, refused(INVALID, error))
    claim = _claim_of(spec, seen.uid, storage.uri, means.installation())
    key = _key(claim, spec.spec)
    if note.claimed == key:
        return Possession(storage, asked)
    async with means.lock(seen.ref):
        there = await asyncio.to_thread(_settled, means, claim)
        if there is not None and there.uid != claim.uid:
            return Possession(None, Asked(refusal=_of_others(there, means.platform.uri)))
        stored = await asyncio.to_thread(read_spec, storage, claim.paths)
        if stored is not None and _fixed(stored.spec) != _fixed(spec.spec):
            return Possession(None, Asked(refusal=_taken(stored.spec, spec.spec, claim)))
        if there is None and stored is not None:
            where = data_uri(storage.uri, claim.root)
            text = f"it goes on from the data of an earlier FleetSpec of this name in {where}"
            await means.cluster.record(seen.body, "Normal", "Adopted", text)
        if there != claim:
            await asyncio.to_thread(write_claim, means.platform, claim)
    note.claimed = key
    return Possession(storage, asked)


def data_uri(storage: str, folder: str) -> str:
    """Address of a folder in a storage; what an address asks for stays behind it."""
    root, mark, asked_for = storage.partition("?")
    return f"{root.rstrip('/')}/{folder}{mark}{asked_for}"


async def _own(means: Means, seen: Seen, asked: Asked) -> Possession:
    """The folder of a FleetSpec that is refused now, and was not when it was claimed."""
    claim = await asyncio.to_thread(read_claim, means.platform, FleetPaths(seen.ref.namespace, seen.ref.name))
    mine = claim is not None and claim.uid == seen.uid
    return Possession(means.storage(claim.uri) if mine and claim is not None else None, asked)


def _settled(means: Means, claim: Claim) -> Claim | None:
    """The claim that is there; that of an earlier FleetSpec of this installation is settled first."""
    there = read_claim(means.platform, claim.paths)
    if there is None or there.uid == claim.uid or not means.is_ours(there):
        return there
    settle(there, means.platform, means.storage(there.uri))
    return None


def _claim_of(spec: FleetSpec, uid: str, uri: str, installation: str) -> Claim:
    namespace = spec.metadata.namespace
    return Claim(
        namespace=namespace,
        fleet=spec.name,
        uid=uid,
        on_delete=spec.spec.storage.on_delete,
        uri=uri,
        root=FleetPaths(namespace, spec.name).root,
        installation=installation,
    )


def _key(claim: Claim, fleet: Fleet) -> str:
    """Changes whenever possession must be looked at again."""
    text = claim.model_dump_json() + repr(_fixed(fleet))
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def _fixed(fleet: Fleet) -> tuple[object, ...]:
    """What data in storage cannot follow."""
    return (tuple(agent.name for agent in fleet.agents.resolved), fleet.state_space.groups, fleet.sa.kind)


def _of_others(claim: Claim, platform: str) -> Trouble:
    """The folder may be in use elsewhere, by a FleetSpec that this cluster knows nothing of."""
    whose = f"installation {claim.installation}" if claim.installation else "an installation that is not known"
    return Trouble(
        STORAGE_TAKEN,
        f"{data_uri(claim.uri, claim.root)} belongs to the FleetSpec {claim.uid} of {whose}, which shares this "
        "storage; choose another name or namespace, or, when that FleetSpec is gone for good, delete "
        f"{claim.paths.claim} in {platform}",
        lasting=True,
    )


def _taken(stored: Fleet, asked: Fleet, claim: Claim) -> Trouble:
    pairs = zip(_FIXED, _fixed(stored), _fixed(asked), strict=True)
    changed = [name for name, was, now in pairs if was != now]
    return Trouble(
        STORAGE_TAKEN,
        f"{data_uri(claim.uri, claim.root)} has the data of a fleet with other {' and '.join(changed)}; "
        "choose another name, delete that folder, or change them back",
        lasting=True,
    )

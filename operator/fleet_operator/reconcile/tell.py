"""Saying what a fleet has come to: its status, the status of its missions, and events."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from fleet.missions.records import read_log
from fleet.spec.resources import MissionStatus
from fleet_operator.cluster.errors import NotFound
from fleet_operator.cluster.port import Cluster
from fleet_operator.policy.lifecycle import Progress
from fleet_operator.policy.mission_status import MissionSituation, mission_status
from fleet_operator.policy.status import Situation, Trouble, fleet_status, status_manifest, status_of
from fleet_operator.policy.story import story
from fleet_operator.policy.times import rfc3339
from fleet_operator.reconcile.claiming import data_uri
from fleet_operator.reconcile.decide import Decided
from fleet_operator.reconcile.note import Note
from fleet_operator.reconcile.seen import Seen
from fleet_operator.resources import names
from fleet_operator.resources.conditions import FleetCondition, Truth
from fleet_operator.resources.refs import FLEET_SPEC, MISSION, Manifest, ObjectRef
from fleet_operator.resources.roles import Role
from fleet_operator.resources.views import JobState

_MOST_LOGS = 16
_FINAL = ("Succeeded", "Failed")


def situation_of(decided: Decided, troubles: tuple[Trouble, ...], now_s: float) -> Situation:
    """All that the fleet's status is made of. Raises StorageError."""
    observed, progress = decided.observed, decided.progress
    ended = [number for number, each in enumerate(progress.missions, start=1) if each.evaluated]
    asked = observed.asked.flown or observed.flown
    return Situation(
        generation=observed.seen.generation,
        step=decided.step,
        refusal=observed.asked.refusal,
        progress=progress,
        shaped=observed.paths.reward in observed.records.objects,
        last=observed.records.evaluation(ended[-1]) if ended else None,
        troubles=troubles,
        storage_uri=data_uri(observed.storage.uri, observed.paths.root),
        now=rfc3339(now_s),
        missions=0 if asked is None else asked.fleet.missions.count,
    )


def unobserved(generation: int, refusal: Trouble | None, now_s: float) -> Situation:
    """What is known of a fleet of which nothing could be observed, or of which there is nothing."""
    return Situation(generation, None, refusal, Progress(now_s=now_s), False, None, (), "", rfc3339(now_s))


def mission_situations(decided: Decided, note: Note, now_s: float) -> dict[int, MissionSituation]:
    """The same of every mission whose Mission object does not say its end yet. Raises StorageError."""
    observed = decided.observed
    found: dict[int, MissionSituation] = {}
    for number, body in sorted(observed.seen.missions.items()):
        if number > decided.mission or _is_final(body, decided, number):
            continue
        found[number] = _mission_situation(decided, note, number, now_s)
    if decided.mission and decided.mission not in observed.seen.missions:
        # Its Mission is made in this pass. One that was there before and is gone says again when its mission ended.
        ended_s = decided.progress.missions[-1].ended_s
        at_s = now_s if ended_s is None else ended_s
        found[decided.mission] = _mission_situation(decided, note, decided.mission, at_s)
    return found


async def tell_fleet(cluster: Cluster, seen: Seen, situation: Situation) -> None:
    """Write a fleet's status, and an event for each thing in it that is new.

    Events go first: it is better that one is counted twice than that it is lost.
    """
    body = cluster.fleet(seen.ref)
    if body is None or body["metadata"].get("uid", "") != seen.uid:
        return
    before = status_of(body)
    after = fleet_status(situation, before)
    for kind, reason, message in story(before, after):
        await cluster.record(body, kind, reason, message)
    try:
        await cluster.apply_status(FLEET_SPEC, seen.ref, status_manifest(after))
    except NotFound:
        return  # deleted meanwhile


async def tell_missions(cluster: Cluster, seen: Seen, situations: Mapping[int, MissionSituation]) -> None:
    """Write the status of missions."""
    missions = cluster.missions(seen.ref)
    for number, situation in situations.items():
        body = missions.get(number)
        if body is None:
            continue
        generation = int(body["metadata"].get("generation", 1))
        status = mission_status(replace(situation, generation=generation), mission_status_of(body))
        try:
            await cluster.apply_status(MISSION, ObjectRef.of(body), status_manifest(status))
        except NotFound:
            continue


def mission_status_of(body: Manifest) -> MissionStatus | None:
    """The status that a Mission has; None when it has none, or one of another version."""
    try:
        return MissionStatus.model_validate(body["status"]) if body.get("status") else None
    except ValueError:
        return None


def said_to_be_at_rest(seen: Seen) -> bool:
    """Whether the status that was written last says of this very FleetSpec that nothing is left to do.

    It is the last thing that a pass writes. So a new operator does not look into the storage of a thousand fleets.
    """
    status = status_of(seen.body)
    if status is None or status.observed_generation != seen.generation or status.phase not in ("Done", "Suspended"):
        return False
    return not any(each.type == FleetCondition.DEGRADED and each.status == Truth.TRUE for each in status.conditions)


def _is_final(body: Manifest, decided: Decided, number: int) -> bool:
    """Whether a Mission says its end already; one that failed may be flown again."""
    phase = body.get("status", {}).get("phase", "")
    return phase in _FINAL and (phase != "Failed" or number < decided.mission)


def _mission_situation(decided: Decided, note: Note, number: int, now_s: float) -> MissionSituation:
    observed, progress = decided.observed, decided.progress.missions[number - 1]
    records, paths, fleet = observed.records, observed.paths, observed.seen.ref.name
    landings = {agent: records.landing(number, agent) for agent in progress.landed} if not progress.evaluated else {}
    flying = [agent for agent in observed.agents if agent not in progress.landed]
    return MissionSituation(
        agents=observed.agents,
        progress=progress,
        records_uri=data_uri(observed.storage.uri, paths.mission(number)),
        now=rfc3339(now_s),
        running=frozenset(
            agent
            for agent in flying
            if observed.seen.state(names.mission_job(Role.WORKFLOW, fleet, number, agent)) is JobState.RUNNING
        ),
        failures={agent: each.message for agent, each in landings.items() if each is not None and each.failed},
        steps={} if progress.evaluated else _steps(decided, note, number),
        evaluation=records.evaluation(number),
        broken=decided.plan.broken if number == decided.mission else "",
    )


def _steps(decided: Decided, note: Note, number: int) -> dict[str, int]:
    """States that each agent has visited. Only the logs that have grown most since they were read are read again."""
    observed = decided.observed
    logs = {agent: observed.paths.log(number, agent) for agent in observed.agents}
    sizes = {path: observed.records.sizes.get(path, 0) for path in logs.values()}
    growth = {path: sizes[path] - note.steps.get(path, (0, 0))[0] for path in logs.values()}
    for path in sorted((path for path in growth if growth[path]), key=lambda path: -growth[path])[:_MOST_LOGS]:
        note.steps[path] = (sizes[path], len(read_log(observed.storage.read(path))))
    return {agent: note.steps.get(path, (0, 0))[1] for agent, path in logs.items()}

"""Giving aggregators that still run what those that are over had."""

from __future__ import annotations

from dataclasses import replace

from fleet_operator.cluster.port import Cluster
from fleet_operator.compiler.resizing import resizes
from fleet_operator.compiler.target import AggregatorTerms
from fleet_operator.flow.orders import total_for
from fleet_operator.policy.shares import Capacity, Share, shares_of_the_rest
from fleet_operator.reconcile.decide import Decided
from fleet_operator.reconcile.note import Note
from fleet_operator.resources import names
from fleet_operator.resources.roles import Role
from fleet_operator.resources.views import JobState, NodeView, PodView


async def resize_running(cluster: Cluster, decided: Decided, number: int, note: Note) -> None:
    """Divide the room anew among the aggregators of a mission, whenever some have ended since the last time."""
    jobs = [job for job in decided.observed.seen.jobs.values() if job.role is Role.AGGREGATOR and job.mission == number]
    finished = frozenset(job.subset for job in jobs if job.state.over)
    running = {job.ref.name: job.subset for job in jobs if job.state is JobState.RUNNING}
    if not finished or not running or (number, finished) == note.resized:
        return
    pods = {running[pod.job]: pod for pod in await cluster.pods(decided.observed.seen.ref) if _runs(pod, running)}
    name = names.main_container(Role.AGGREGATOR)
    has = {subset: pod.containers.get(name, {}) for subset, pod in pods.items()}
    terms = [_fitting(each, pods, decided.observed.seen.nodes) for each in _new_terms(decided, number, finished)]
    for subset, resources in resizes(decided.observed.target, terms, has).items():
        await cluster.resize(pods[subset], name, resources)
    note.resized = (number, finished)


def _runs(pod: PodView, running: dict[str, str]) -> bool:
    return pod.job in running and pod.phase == "Running" and not pod.deleting


def _new_terms(decided: Decided, number: int, finished: frozenset[str]) -> list[AggregatorTerms]:
    terms, room = decided.observed.terms(number), decided.observed.seen.room
    levels = {each.subset: each.level for each in terms}
    total = total_for(decided.observed.target.fleet, room)
    divided = shares_of_the_rest(levels, finished, total, room.largest)
    return [replace(each, share=divided[each.subset]) for each in terms if each.subset in divided]


def _fitting(terms: AggregatorTerms, pods: dict[str, PodView], nodes: tuple[NodeView, ...]) -> AggregatorTerms:
    """Never more than the node has on which the aggregator runs."""
    pod = pods.get(terms.subset)
    node = next((node for node in nodes if pod is not None and node.name == pod.node), None)
    if node is None or terms.share is None:
        return terms
    limit, request = terms.share.limit, terms.share.request
    most = Capacity(min(limit.cores, node.cores), min(limit.memory_bytes, node.memory_bytes))
    return replace(terms, share=Share(most, request))

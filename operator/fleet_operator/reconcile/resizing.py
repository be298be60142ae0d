"""Giving aggregators that run what those that are over had, and what those that find no room do not use yet."""

from __future__ import annotations

import logging
from dataclasses import replace

from fleet_operator.cluster.errors import Forbidden, Invalid
from fleet_operator.cluster.port import Cluster
from fleet_operator.compiler.resizing import resizes
from fleet_operator.compiler.target import AggregatorTerms
from fleet_operator.flow.orders import terms_of_the_rest
from fleet_operator.policy.shares import Capacity, Share
from fleet_operator.reconcile.decide import Decided
from fleet_operator.reconcile.note import Note
from fleet_operator.resources import names
from fleet_operator.resources.refs import Manifest
from fleet_operator.resources.roles import Role
from fleet_operator.resources.views import JobState, NodeView, PodView

log = logging.getLogger(__name__)


async def resize_running(cluster: Cluster, decided: Decided, number: int, note: Note) -> None:
    """Divide the room anew among the aggregators of a mission, whenever others run or are over than the last time."""
    jobs = [job for job in decided.observed.seen.jobs.values() if job.role is Role.AGGREGATOR and job.mission == number]
    finished = frozenset(job.subset for job in jobs if job.state.over)
    pending = {job.ref.name: job.subset for job in jobs if job.state is JobState.PENDING}
    running = {job.ref.name: job.subset for job in jobs if job.state is JobState.RUNNING}
    now = (number, finished, frozenset(running.values()))
    if not running or not (finished or pending) or now == note.resized:
        return
    listed = [pod for pod in await cluster.pods(decided.observed.seen.ref) if not pod.deleting]
    pods = {running[pod.job]: pod for pod in listed if pod.job in running and pod.phase == "Running"}
    queueing = {pending[pod.job] for pod in listed if pod.job in pending and pod.finds_no_node}
    observed = decided.observed
    rest = terms_of_the_rest(observed.target.fleet, observed.terms(number), finished | queueing, observed.seen.room)
    terms = [_fitting(each, pods, observed.seen.nodes) for each in rest]
    name = names.main_container(Role.AGGREGATOR)
    has = {subset: pod.containers.get(name, {}) for subset, pod in pods.items()}
    wanted = resizes(observed.target, terms, has)
    refusals = [await _resize(cluster, pods[subset], name, resources) for subset, resources in wanted.items()]
    note.resized = now
    if any(refusals) and note.refused_resize != number:
        note.refused_resize = number
        told = next(filter(None, refusals))
        log.warning("%s: some aggregators of mission %d keep what they have: %s", observed.seen.ref, number, told)


async def _resize(cluster: Cluster, pod: PodView, container: str, resources: Manifest) -> str:
    """Why a container may not be resized; "" when it was, or its machine cannot. It works on with what it has."""
    try:
        await cluster.resize(pod, container, resources)
    except (Forbidden, Invalid) as error:  # a ResourceQuota, a LimitRange, a policy of the cluster
        return str(error)
    return ""


def _fitting(terms: AggregatorTerms, pods: dict[str, PodView], nodes: tuple[NodeView, ...]) -> AggregatorTerms:
    """Never more than the node has on which the aggregator runs."""
    pod = pods.get(terms.subset)
    node = next((node for node in nodes if pod is not None and node.name == pod.node), None)
    if node is None or terms.share is None:
        return terms
    limit, request = terms.share.limit, terms.share.request
    most = Capacity(min(limit.cores, node.cores), min(limit.memory_bytes, node.memory_bytes))
    return replace(terms, share=Share(most, request))

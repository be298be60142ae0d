"""Why Jobs are not ready: what Kubernetes says of their pods, and what it complains about.

It is asked only for Jobs that are not ready for a while, so a fleet without trouble costs no call.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from fleet_operator.cluster.port import Cluster
from fleet_operator.policy.status import Trouble
from fleet_operator.policy.troubles import of_agents, of_aggregator, of_jobs_complaint, of_pod, of_pods_complaint
from fleet_operator.reconcile.decide import Decided
from fleet_operator.reconcile.note import Looked, Note
from fleet_operator.resources.refs import JOB, POD
from fleet_operator.resources.roles import Role
from fleet_operator.resources.views import JobState, JobView, NodeView, PodView

PATIENCE_S = 10.0
"""How long a pod may take to start before somebody looks why."""
FIRST_PAUSE_S = 10.0
LONGEST_PAUSE_S = 30.0
AT_ONCE = 2
_MOST_COMPLAINTS = 3
_MOST_TROUBLES = 3
_WORDY = {"ImageMissing", "ConfigMissing"}


@dataclass(frozen=True)
class Diagnosis:
    """What was found.

    Args:
        troubles: What is not as it should be, the worst first.
        lost: Jobs whose pods were told to end on machines that are gone, and so never say that they did. Kubernetes
            makes no other pod before that (Kubernetes, "Jobs", podReplacementPolicy), so the Job is made anew.
    """

    troubles: tuple[Trouble, ...] = ()
    lost: tuple[JobView, ...] = ()


class Diagnoser:
    """Looks what is not as it should be with fleets.

    The API server reads all Events of a namespace to find those of one Job. So when nothing changes, it is asked ever
    more rarely; and when a thousand fleets wait, at most a few of them are looked at at the same time, and the others
    go on with what they know.
    """

    def __init__(self, cluster: Cluster) -> None:
        self._cluster = cluster
        self._places = asyncio.Semaphore(AT_ONCE)

    async def diagnose(self, decided: Decided, note: Note, now_s: float) -> Diagnosis:
        """Look what is not as it should be with a fleet.

        Args:
            note: Keeps what was found, and what was said of a trouble: kubelets say it in other words at every look.

        Raises:
            ClusterError: the API server refuses.
        """
        waiting = [
            job
            for job in decided.observed.seen.jobs.values()
            if job.state is JobState.PENDING and not job.deleting and now_s - job.created_s > PATIENCE_S
        ]
        if not waiting or decided.step is None:
            note.told, note.looked = {}, None
            return Diagnosis(tuple(_of_failed(decided)))
        silent = frozenset(node.name for node in decided.observed.seen.nodes if not node.ready)
        at = (frozenset(job.uid for job in waiting), silent)
        looked = note.looked if note.looked is not None and note.looked.at == at else None
        if (looked is None or now_s >= looked.again_s) and not self._places.locked():
            async with self._places:
                found, lost = await _look(self._cluster, decided, waiting, now_s)
            pause_s = FIRST_PAUSE_S if looked is None else min(2.0 * looked.pause_s, LONGEST_PAUSE_S)
            looked = note.looked = Looked(at, found, lost, pause_s, now_s + pause_s)
        if looked is None:
            return Diagnosis(tuple(_of_failed(decided)))
        return Diagnosis((*_worded(looked.found, decided, note), *_of_failed(decided)), looked.lost)


async def _look(
    cluster: Cluster, decided: Decided, waiting: Sequence[JobView], now_s: float
) -> tuple[tuple[Trouble, ...], tuple[JobView, ...]]:
    """Troubles, and Jobs that are lost."""
    by_job: dict[str, list[PodView]] = {}
    for pod in await cluster.pods(decided.observed.seen.ref):
        by_job.setdefault(pod.job, []).append(pod)
    lost = tuple(job for job in waiting if _is_lost(by_job.get(job.ref.name, []), decided.observed.seen.nodes))
    found = await _of_waiting(cluster, decided, [job for job in waiting if job not in lost], by_job, now_s)
    gone = sorted({pod.node for job in lost for pod in _live(by_job[job.ref.name])})
    if gone:
        found.insert(0, Trouble("NodeLost", f"{', '.join(gone)} is gone; its pods are started on other machines"))
    return tuple(found), lost


def _worded(found: Sequence[Trouble], decided: Decided, note: Note) -> list[Trouble]:
    """Troubles in the words in which they were told first; none lasts while something goes on."""
    if _goes_on(decided):
        found = [replace(each, lasting=False) for each in found]
    note.told = {each.reason: note.told.get(each.reason, each.message) for each in found if each.reason in _WORDY}
    return [replace(each, message=note.told.get(each.reason, each.message)) for each in found]


def _is_lost(pods: Sequence[PodView], nodes: Sequence[NodeView]) -> bool:
    ready = {node.name for node in nodes if node.ready}
    live = _live(pods)
    return bool(live) and all(pod.deleting and pod.node and pod.node not in ready for pod in live)


def _of_failed(decided: Decided) -> list[Trouble]:
    """Agents and aggregators that the mission goes on without."""
    found: list[Trouble] = []
    if not decided.mission:
        return found
    records, number = decided.observed.records, decided.mission
    evaluation = records.evaluation(number)
    failures = dict(evaluation.failures) if evaluation is not None else _fallen(decided, number)
    if failures:
        found.append(of_agents(number, failures))
    found += [of_aggregator(number, subset, message) for subset, message in sorted(decided.given_up.items())]
    return found


def _fallen(decided: Decided, number: int) -> dict[str, str]:
    landed = decided.progress.missions[number - 1].landed
    landings = {agent: decided.observed.records.landing(number, agent) for agent in sorted(landed)}
    return {agent: each.message for agent, each in landings.items() if each is not None and each.failed}


async def _of_waiting(
    cluster: Cluster,
    decided: Decided,
    waiting: Sequence[JobView],
    by_job: Mapping[str, Sequence[PodView]],
    now_s: float,
) -> list[Trouble]:
    found: dict[str, Trouble] = {}
    podless = [job for job in waiting if not _live(by_job.get(job.ref.name, []))]
    for job in waiting:
        if len(found) == _MOST_TROUBLES:
            break
        for pod in by_job.get(job.ref.name, []):
            trouble = of_pod(job.ref.name, pod, now_s) or await _of_volumes(cluster, job, pod)
            if trouble is not None and not _is_queueing(trouble, job, decided):
                found.setdefault(trouble.reason, trouble)
    for job in podless[:_MOST_COMPLAINTS]:
        for reason, message in await cluster.complaints(job.ref, JOB.kind):
            trouble = of_jobs_complaint(job.ref.name, reason, message)
            if trouble is not None:
                found.setdefault(trouble.reason, trouble)
                break
    return list(found.values())


def _live(pods: Sequence[PodView]) -> list[PodView]:
    return [pod for pod in pods if pod.phase not in ("Failed", "Succeeded")]


async def _of_volumes(cluster: Cluster, job: JobView, pod: PodView) -> Trouble | None:
    if pod.phase != "Pending" or not pod.node:
        return None
    complaints = await cluster.complaints(pod.ref, POD.kind)
    found = (of_pods_complaint(job.ref.name, reason, message) for reason, message in complaints)
    return next((trouble for trouble in found if trouble is not None), None)


def _goes_on(decided: Decided) -> bool:
    """Whether a Job is at work that the fleet waits for; a sensor only serves its workflow."""
    jobs = decided.observed.seen.jobs.values()
    return any(job.state is JobState.RUNNING and job.role is not Role.SENSOR for job in jobs)


def _is_queueing(trouble: Trouble, job: JobView, decided: Decided) -> bool:
    """Aggregators wait for each other by design: that some find no node is no trouble while one runs."""
    if trouble.reason != "Unschedulable" or job.role is not Role.AGGREGATOR:
        return False
    jobs = decided.observed.seen.jobs.values()
    return any(each.role is Role.AGGREGATOR and each.state is JobState.RUNNING for each in jobs)

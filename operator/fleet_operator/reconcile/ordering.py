"""The steps that a pass takes itself: FleetSpec and contexts to storage, orders, landings, and starting over."""

from __future__ import annotations

import asyncio

from fleet.errors import ContextError, SpecError
from fleet_operator.flow.stored import functions_of, kept_form, replaced_functions
from fleet_operator.reconcile import work
from fleet_operator.reconcile.asked import CONTEXT_BROKEN, FILES_MISSING, Asked, refused
from fleet_operator.reconcile.decide import Again, Decided
from fleet_operator.reconcile.means import Means
from fleet_operator.reconcile.note import Note
from fleet_operator.reconcile.observe import Observed
from fleet_operator.resources import names
from fleet_operator.resources.refs import CONFIG_MAP, JOB, MISSION, ObjectRef
from fleet_operator.resources.roles import Role


async def prepare(means: Means, observed: Observed, note: Note) -> Asked:
    """Put what is asked for into storage; it is refused when a context is not a good one.

    Raises:
        StorageError: the storage refuses.
    """
    await _forget_functions(means, observed)
    try:
        note.stored = await asyncio.to_thread(work.prepare, observed, means.shelf(observed.seen), means.visit)
    except ContextError as error:
        return refused(CONTEXT_BROKEN, error)
    except SpecError as error:
        return refused(FILES_MISSING, error)
    if note.known is not None:
        note.known[observed.paths.fleet_spec] = 0
    note.functions = None if observed.asked.flown is None else observed.asked.flown.bundle
    return observed.asked


async def _forget_functions(means: Means, observed: Observed) -> None:
    """Delete the functions of which nothing in storage will tell any more, before that is written.

    Storage knows of those that are in force and of those before. They may change more than once before an order.
    """
    if observed.stored is None or observed.asked.flown is None:
        return
    kept = kept_form(observed.asked.flown, observed.stored)
    lost = replaced_functions(observed.stored)
    if lost and lost not in (functions_of(kept), replaced_functions(kept)):
        await _delete_functions(means, observed, lost)


async def _delete_functions(means: Means, observed: Observed, digest: str) -> None:
    ref = observed.seen.ref
    await means.cluster.delete(CONFIG_MAP, ObjectRef(ref.namespace, names.functions(ref.name, digest)))


async def order(means: Means, observed: Observed, number: int, note: Note) -> Asked:
    """Order a mission: with what is asked for now, and without the functions that this took the place of.

    Raises:
        StorageError, ClusterError: to be tried again.
    """
    asked = await prepare(means, observed, note)
    if asked.refusal is not None or note.stored is None:
        return asked
    replaced = replaced_functions(note.stored)
    if replaced:
        await _delete_functions(means, observed, replaced)
    await asyncio.to_thread(work.order, observed, number)
    return asked


async def land(means: Means, decided: Decided) -> bool:
    """Write the landings that nobody else will write; not before the agent's pods are gone.

    Returns:
        Whether one was written.
    """
    landed = False
    for agent, reason in decided.plan.fallen.items():
        name = names.mission_job(Role.WORKFLOW, decided.observed.seen.ref.name, decided.mission, agent)
        pods = await means.cluster.pods(decided.observed.seen.ref, name)
        if all(pod.phase in ("Failed", "Succeeded") for pod in pods):
            await asyncio.to_thread(work.land, decided.observed, decided.mission, agent, reason)
            landed = True
    return landed


async def start_over(means: Means, decided: Decided, note: Note) -> None:
    """A mission came to nothing, and the user has changed something since: its Jobs go first, then what they left.

    When all agents failed, the mission is ordered anew. When only the evaluation failed, what was flown is kept, and
    is evaluated with what is asked for now.
    """
    observed, number, fleet = decided.observed, decided.mission, decided.observed.seen.ref.name
    evaluators = {names.evaluate_job(fleet, number, agent) for agent in observed.agents}
    jobs = [
        job
        for job in observed.seen.jobs.values()
        if job.mission == number and (decided.again is Again.MISSION or job.ref.name in evaluators)
    ]
    for job in jobs:
        if not job.deleting:
            await means.cluster.delete(JOB, job.ref, job.uid)
    if jobs:
        return
    note.documents.clear()
    if decided.again is Again.MISSION:
        # What a Mission is of never changes, and this one may be flown over another context now.
        await means.cluster.delete(MISSION, ObjectRef(observed.seen.ref.namespace, names.mission(fleet, number)))
        await asyncio.to_thread(observed.storage.delete, observed.paths.plan(number))
    else:
        await prepare(means, observed, note)

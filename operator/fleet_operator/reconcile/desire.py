"""Which objects a step wants in the cluster, and which are there and no longer wanted."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from fleet_operator.compiler.fleet import function_sources
from fleet_operator.compiler.missions import (
    aggregator_job,
    evaluate_job,
    mission_manifest,
    sensor_job,
    sensor_service,
    training_job,
    weighing_job,
    workflow_job,
)
from fleet_operator.compiler.network import network_policies
from fleet_operator.compiler.target import AggregatorTerms, Placement
from fleet_operator.flow.orders import in_waves
from fleet_operator.policy.lifecycle import Done, Failed, Fly, Retrain, Suspended, Train, Wait, Weigh
from fleet_operator.reconcile.decide import Decided
from fleet_operator.resources import names
from fleet_operator.resources.refs import JOB, SERVICE, Kind, Manifest, ObjectRef
from fleet_operator.resources.roles import Role
from fleet_operator.resources.views import JobView

KEPT_MISSIONS = 2
"""The current mission and the one before keep their Jobs, for `kubectl logs`."""


@dataclass(frozen=True)
class WantedJob:
    """A Job that is to be there; it is compiled only when it is not."""

    name: str
    compiled: Callable[[], Manifest]


@dataclass(frozen=True)
class Unwanted:
    """An object that is to go."""

    kind: Kind
    ref: ObjectRef
    uid: str = ""


@dataclass(frozen=True)
class Desired:
    """What a step wants.

    Args:
        objects: Everything but Jobs, in the order in which it is needed.
        waves: Jobs; those of a wave are made side by side, and no wave before the one before it is there.
        unwanted: What is to go.
    """

    decided: Decided
    objects: tuple[Manifest, ...] = ()
    waves: tuple[tuple[WantedJob, ...], ...] = ()
    unwanted: tuple[Unwanted, ...] = ()

    @property
    def unwanted_waves(self) -> tuple[tuple[Unwanted, ...], ...]:
        """What is to go: Jobs when all else is gone, as they tell of what there is else."""
        others = tuple(each for each in self.unwanted if each.kind != JOB)
        return others, tuple(each for each in self.unwanted if each.kind == JOB)


def desire(decided: Decided, placement: Mapping[str, Placement]) -> Desired:
    """What a decision wants.

    Args:
        placement: Where the data of subsets is, as far as it is known.
    """
    wanted = _wanted(decided, placement)
    named = {job.name for wave in wanted.waves for job in wave}
    unwanted = [*_stopped(decided), *_outdated(decided)]
    return replace(wanted, unwanted=tuple(each for each in unwanted if each.kind != JOB or each.ref.name not in named))


def _wanted(decided: Decided, placement: Mapping[str, Placement]) -> Desired:
    match decided.step:
        case Train():
            target = decided.observed.target
            wanted = WantedJob(names.training_job(target.spec.name), lambda: training_job(target))
            return Desired(decided, _base(decided), ((wanted,),))
        case Fly(number=number):
            services, jobs = _flight(decided, number)
            return Desired(decided, (*_base(decided, number), *services), jobs)
        case Retrain(number=number):
            return Desired(decided, _base(decided, number), _retraining(decided, number, placement))
        case Weigh(number=number):
            target = decided.observed.target
            wanted = WantedJob(names.weighing_job(target.spec.name, number), lambda: weighing_job(target, number))
            return Desired(decided, _base(decided, number), ((wanted,),))
        case Wait() | Suspended() | Failed() | Done():
            return Desired(decided, _last_mission(decided))
        case _:
            return Desired(decided)


def _base(decided: Decided, mission: int = 0) -> tuple[Manifest, ...]:
    """What all pods of a fleet need, and the Mission object."""
    target = decided.observed.target
    mission_object = [mission_manifest(target, mission)] if mission else []
    return (*function_sources(target), *network_policies(target), *mission_object)


def _last_mission(decided: Decided) -> tuple[Manifest, ...]:
    """The Mission object of the mission that was flown last, when it is gone: it says when that mission ended.

    It is of what was flown. The FleetSpec of the cluster may ask for another context by now.
    """
    observed = decided.observed
    if not decided.mission or decided.mission in observed.seen.missions or observed.stored is None:
        return ()
    spec = observed.target.spec.model_copy(update={"spec": observed.stored.spec})
    return (mission_manifest(replace(observed.target, spec=spec), decided.mission),)


def _flight(decided: Decided, number: int) -> tuple[tuple[Manifest, ...], tuple[tuple[WantedJob, ...], ...]]:
    """Sensors first: whoever finds a workflow finds its sensor."""
    target, plan = decided.observed.target, decided.plan
    fleet = target.spec.name
    if plan.evaluator:
        agent = plan.evaluator
        name = names.evaluate_job(fleet, number, agent)
        return (), ((WantedJob(name, lambda: evaluate_job(target, number, agent)),),)
    services = tuple(sensor_service(target, number, agent) for agent in plan.flying)
    builders = ((Role.SENSOR, sensor_job), (Role.WORKFLOW, workflow_job))
    waves = tuple(
        tuple(
            WantedJob(names.mission_job(role, fleet, number, agent), _job(builder, decided, number, agent))
            for agent in plan.flying
        )
        for role, builder in builders
    )
    return services, waves


def _job(builder: Callable[..., Manifest], decided: Decided, number: int, agent: str) -> Callable[[], Manifest]:
    return lambda: builder(decided.observed.target, number, agent)


def _retraining(decided: Decided, number: int, placement: Mapping[str, Placement]) -> tuple[tuple[WantedJob, ...], ...]:
    """All aggregators, those that are suspended first: they are there whenever the others are. Then level by level."""
    target = decided.observed.target
    retrained = decided.progress.missions[number - 1].retrained
    over = retrained.union(decided.given_up)
    terms = [each for each in decided.observed.terms(number) if each.subset not in over]

    def wanted(each: AggregatorTerms) -> WantedJob:
        name = names.mission_job(Role.AGGREGATOR, target.spec.name, number, each.subset)
        return WantedJob(name, lambda: aggregator_job(target, number, each, placement.get(each.subset)))

    return tuple(tuple(wanted(each) for each in wave) for wave in in_waves(terms))


def _stopped(decided: Decided) -> list[Unwanted]:
    return [Unwanted(JOB, job.ref, job.uid) for job in decided.plan.stopped if not job.deleting]


def _outdated(decided: Decided) -> list[Unwanted]:
    """Jobs of missions before the last two; a sensor's Service goes before its Job, which is what tells of it."""
    first = decided.mission - KEPT_MISSIONS + 1
    unwanted: list[Unwanted] = []
    for job in decided.observed.seen.jobs.values():
        if decided.step is None or job.mission >= first or job.deleting:
            continue
        if job.role is Role.SENSOR:
            unwanted.append(Unwanted(SERVICE, _service(job, decided.observed.seen.ref.name)))
        unwanted.append(Unwanted(JOB, job.ref, job.uid))
    return unwanted


def _service(job: JobView, fleet: str) -> ObjectRef:
    return ObjectRef(job.ref.namespace, names.sensor_service(fleet, job.mission, job.agent))

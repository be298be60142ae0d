"""The Jobs of one mission: sensor and AS workflow of each agent, aggregators, and the weighing after it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from fleet.spec.base import API_VERSION, Resources
from fleet.spec.learning import SAKind
from fleet_operator.compiler import defaults
from fleet_operator.compiler.containers import Program, container, liveness, readiness, resizable, sidecar
from fleet_operator.compiler.jobs import Identity, fleet_metadata, job, labels, mission_metadata
from fleet_operator.compiler.quantities import of_share, settled, to_manifest, whole_cores
from fleet_operator.compiler.target import AggregatorTerms, Placement, Target, UserFunction, user_functions
from fleet_operator.resources import names
from fleet_operator.resources.roles import EVALUATE, REAL_TIME_LEVEL, TRAINER_LEVEL, Role, TrainerTask

Manifest = dict[str, Any]


def compile_flight(target: Target, mission: int, agents: Sequence[str] | None = None) -> list[Manifest]:
    """Sensor, Service and AS workflow of some agents, or of all when none are named."""
    everyone = [agent.name for agent in target.fleet.agents.resolved]
    return [manifest for agent in agents or everyone for manifest in _agent_objects(target, mission, agent)]


def _agent_objects(target: Target, mission: int, agent: str) -> list[Manifest]:
    return [
        sensor_service(target, mission, agent),
        sensor_job(target, mission, agent),
        workflow_job(target, mission, agent),
    ]


def sensor_service(target: Target, mission: int, agent: str) -> Manifest:
    """The headless Service that gives an agent's sensor a name.

    The name is there as soon as the pod has an address: a workflow tries again until the sensor answers, while a name
    that was not found is remembered as missing for seconds.
    """
    identity = _identity(target, Role.SENSOR, mission, agent)
    selector = (names.FLEET_LABEL, names.MISSION_LABEL, names.ROLE_LABEL, names.AGENT_LABEL)
    shown = labels(target, identity)
    port = names.main_container(Role.SENSOR)
    return {
        "apiVersion": "v1",
        "kind": "Service",
        "metadata": mission_metadata(target, identity),
        "spec": {
            "clusterIP": "None",
            "publishNotReadyAddresses": True,
            "selector": {key: shown[key] for key in selector},
            "ports": [{"name": port, "port": target.settings.ports.sensor, "targetPort": port}],
        },
    }


def sensor_job(target: Target, mission: int, agent: str) -> Manifest:
    """The sensor of one agent: its action driver behind HTTP."""
    resources = settled(target.fleet.workflow.sensor_resources, defaults.SENSOR, "spec.workflow.sensorResources")
    name = names.main_container(Role.SENSOR)
    program = Program(
        name,
        (*target.settings.role_command, "sensor"),
        resources,
        {"FLEET_MISSION": str(mission), "FLEET_AGENT": agent},
        port=target.settings.ports.sensor,
    )
    main = container(target, program)
    main["readinessProbe"] = readiness(name)
    main["livenessProbe"] = liveness(name)
    return job(target, _identity(target, Role.SENSOR, mission, agent), main)


def workflow_job(target: Target, mission: int, agent: str) -> Manifest:
    """The AS workflow of one agent, with Map() and Eval() beside it."""
    identity = _identity(target, Role.WORKFLOW, mission, agent)
    return _workflow(target, identity, user_functions(target))


def evaluate_job(target: Target, mission: int, agent: str) -> Manifest:
    """A workflow that evaluates a mission whose agents have all landed: the agent's, started once more with Eval()."""
    name = names.evaluate_job(target.spec.name, mission, agent)
    identity = replace(_identity(target, Role.WORKFLOW, mission, agent), name=name, task=EVALUATE)
    return _workflow(target, identity, user_functions(target)[1:])


def _workflow(target: Target, identity: Identity, functions: Sequence[UserFunction]) -> Manifest:
    service = names.sensor_service(target.spec.name, identity.mission, identity.agent)
    program = Program(
        names.main_container(Role.WORKFLOW),
        (*target.settings.role_command, "workflow"),
        settled(target.fleet.workflow.resources, _workflow_default(target), "spec.workflow.resources"),
        {
            "FLEET_MISSION": str(identity.mission),
            "FLEET_AGENT": identity.agent,
            "FLEET_SENSOR_URL": f"http://{service}:{target.settings.ports.sensor}",
            **{f"FLEET_{each.name.upper()}_URL": f"http://localhost:{each.port}" for each in functions},
        },
    )
    sidecars = [sidecar(target, function) for function in functions]
    return job(target, identity, container(target, program), sidecars)


def mission_manifest(target: Target, mission: int) -> Manifest:
    """The Mission object of a mission: what is flown, for `kubectl get missions`."""
    metadata = fleet_metadata(target, names.mission(target.spec.name, mission))
    metadata["labels"][names.MISSION_LABEL] = str(mission)
    return {
        "apiVersion": API_VERSION,
        "kind": "Mission",
        "metadata": metadata,
        "spec": {
            "fleet": target.spec.name,
            "number": mission,
            "context": target.fleet.state_space.context,
            "seed": target.fleet.missions.seed,
        },
    }


def compile_retraining(
    target: Target, mission: int, terms: Sequence[AggregatorTerms], placement: Mapping[str, Placement] | None = None
) -> list[Manifest]:
    """The aggregators of a mission, in the order of their terms.

    Args:
        placement: Where the data of each subset is, by its key; a subset that is not there may run anywhere.
    """
    places = placement or {}
    return [aggregator_job(target, mission, each, places.get(each.subset)) for each in terms]


def aggregator_job(
    target: Target, mission: int, terms: AggregatorTerms, placement: Placement | None = None
) -> Manifest:
    """The aggregator of one subset, suspended at level 0; resources of the FleetSpec go before its share."""
    program = Program(
        names.main_container(Role.AGGREGATOR),
        (*target.settings.role_command, "aggregator"),
        _aggregator_resources(target, terms),
        {"FLEET_MISSION": str(mission), "FLEET_SUBSET": terms.subset, "FLEET_LEVEL": str(terms.level)},
    )
    name = names.mission_job(Role.AGGREGATOR, target.spec.name, mission, terms.subset)
    identity = Identity(name, Role.AGGREGATOR, terms.level, mission, subset=terms.subset, placement=placement)
    return job(target, identity, resizable(container(target, program)))


def aggregator_resources(target: Target, terms: AggregatorTerms) -> Manifest:
    """`resources` of an aggregator's container."""
    return to_manifest(_aggregator_resources(target, terms))


def _workflow_default(target: Target) -> Resources:
    plans = target.fleet.sa.kind is SAKind.PLANNER
    return defaults.PLANNING_WORKFLOW if plans else defaults.WORKFLOW


def _aggregator_resources(target: Target, terms: AggregatorTerms) -> Resources:
    plans = target.fleet.sa.kind is SAKind.PLANNER
    smallest = defaults.SMALLEST_PLANNING_AGGREGATOR if plans else defaults.SMALLEST_AGGREGATOR
    default = defaults.AGGREGATOR if terms.share is None else of_share(terms.share, smallest)
    return settled(target.fleet.aggregation.resources, default, "spec.aggregation.resources")


def training_job(target: Target) -> Manifest:
    """Reward shaping and training of the first SA."""
    return _trainer_job(target, names.training_job(target.spec.name), TrainerTask.TRAIN, 0)


def weighing_job(target: Target, mission: int) -> Manifest:
    """Weights and usefulness after a mission."""
    return _trainer_job(target, names.weighing_job(target.spec.name, mission), TrainerTask.WEIGH, mission)


def _trainer_job(target: Target, name: str, task: TrainerTask, mission: int) -> Manifest:
    """A trainer; Python functions run in its own processes, images beside it."""
    resources = settled(target.fleet.workflow.trainer_resources, defaults.TRAINER, "spec.workflow.trainerResources")
    images = [each for each in user_functions(target) if each.spec.image is not None]
    workers = whole_cores(resources)
    program = Program(
        names.main_container(Role.TRAINER),
        (*target.settings.role_command, "trainer"),
        resources,
        {
            "FLEET_TASK": task.value,
            "FLEET_WORKERS": str(workers),
            **({"FLEET_MISSION": str(mission)} if mission else {}),
            **{f"FLEET_{each.name.upper()}_URL": f"http://localhost:{each.port}" for each in images},
        },
        workers=workers,
    )
    identity = Identity(name, Role.TRAINER, TRAINER_LEVEL, mission, task=task.value)
    return job(target, identity, container(target, program), [sidecar(target, each) for each in images])


def _identity(target: Target, role: Role, mission: int, agent: str) -> Identity:
    return Identity(names.mission_job(role, target.spec.name, mission, agent), role, REAL_TIME_LEVEL, mission, agent)

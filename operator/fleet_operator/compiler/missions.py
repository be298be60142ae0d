"""The Jobs of one mission: sensor and AS workflow of each agent, aggregators, and the weighing after it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from fleet_operator.compiler import defaults
from fleet_operator.compiler.containers import Program, container, readiness, sidecar
from fleet_operator.compiler.jobs import Identity, job, labels
from fleet_operator.compiler.quantities import of_share, settled, whole_cores
from fleet_operator.compiler.target import AggregatorTerms, Target, user_functions
from fleet_operator.resources import names
from fleet_operator.resources.roles import REAL_TIME_LEVEL, TRAINER_LEVEL, Role, TrainerTask

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
    """The headless Service that gives an agent's sensor a name."""
    identity = _identity(target, Role.SENSOR, mission, agent)
    selector = (names.FLEET_LABEL, names.MISSION_LABEL, names.ROLE_LABEL, names.AGENT_LABEL)
    shown = labels(target, identity)
    port = names.main_container(Role.SENSOR)
    return {
        "apiVersion": "v1",
        "kind": "Service",
        "metadata": {
            "name": names.sensor_service(target.spec.name, mission, agent),
            "namespace": target.spec.metadata.namespace,
            "labels": shown,
        },
        "spec": {
            "clusterIP": "None",
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
    return job(target, _identity(target, Role.SENSOR, mission, agent), main)


def workflow_job(target: Target, mission: int, agent: str) -> Manifest:
    """The AS workflow of one agent, with Map() and Eval() beside it."""
    service = names.sensor_service(target.spec.name, mission, agent)
    functions = user_functions(target)
    program = Program(
        names.main_container(Role.WORKFLOW),
        (*target.settings.role_command, "workflow"),
        settled(target.fleet.workflow.resources, defaults.WORKFLOW, "spec.workflow.resources"),
        {
            "FLEET_MISSION": str(mission),
            "FLEET_AGENT": agent,
            "FLEET_SENSOR_URL": f"http://{service}:{target.settings.ports.sensor}",
            **{f"FLEET_{each.name.upper()}_URL": f"http://localhost:{each.port}" for each in functions},
        },
    )
    sidecars = [sidecar(target, function) for function in functions]
    return job(target, _identity(target, Role.WORKFLOW, mission, agent), container(target, program), sidecars)


def compile_retraining(target: Target, mission: int, terms: Sequence[AggregatorTerms]) -> list[Manifest]:
    """The aggregators of a mission, in the order of their terms."""
    return [aggregator_job(target, mission, each) for each in terms]


def aggregator_job(target: Target, mission: int, terms: AggregatorTerms) -> Manifest:
    """The aggregator of one subset, suspended at level 0; resources of the FleetSpec go before its share."""
    default = defaults.AGGREGATOR if terms.share is None else of_share(terms.share, defaults.SMALLEST_AGGREGATOR)
    program = Program(
        names.main_container(Role.AGGREGATOR),
        (*target.settings.role_command, "aggregator"),
        settled(target.fleet.aggregation.resources, default, "spec.aggregation.resources"),
        {"FLEET_MISSION": str(mission), "FLEET_SUBSET": terms.subset, "FLEET_LEVEL": str(terms.level)},
    )
    name = names.mission_job(Role.AGGREGATOR, target.spec.name, mission, terms.subset)
    identity = Identity(name, Role.AGGREGATOR, terms.level, mission, subset=terms.subset)
    return job(target, identity, container(target, program))


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
    identity = Identity(name, Role.TRAINER, TRAINER_LEVEL, mission)
    return job(target, identity, container(target, program), [sidecar(target, each) for each in images])


def _identity(target: Target, role: Role, mission: int, agent: str) -> Identity:
    return Identity(names.mission_job(role, target.spec.name, mission, agent), role, REAL_TIME_LEVEL, mission, agent)

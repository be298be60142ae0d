"""Rules between the parts of a resource: what no field can say of itself.

The CRD has those of them that Kubernetes can check (`cel`); here they say where, and what to write instead.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from urllib.parse import urlsplit

from fleet.spec.base import POWERSET_LIMIT, Amounts, Resources, duration_s, quantity_value
from fleet.spec.findings import Finding, did_you_mean, listed
from fleet.spec.functions import ContextUse, EvalChecks, FunctionSpec
from fleet.spec.learning import BELIEVED, SAKind
from fleet.spec.platform import STORAGE_ADDRESS, STORAGE_EXAMPLES, AggregationKind
from fleet.spec.resources import EdgeNode, Fleet, FleetSpec, Mission
from fleet.spec.swarm import CAPABILITIES, CARDINAL, Goal
from fleet.spec.yaml_text import Path

SPEC: Path = ("spec",)
LEAST_MEMORY = 2**20
"""Bytes; no program runs in less, so less is a missing unit."""
MOST_CPU = 1000
"""Cores; no machine has more, so more is a unit of memory."""


def broken_rules(resource: FleetSpec | Mission | EdgeNode) -> list[Finding]:
    """Every rule that a resource breaks."""
    match resource:
        case FleetSpec():
            return [finding for rule in FLEET_RULES for finding in rule(resource.spec)]
        case EdgeNode():
            return list(_edge_node(resource))
        case _:
            return []


def _agents(fleet: Fleet) -> Iterator[Finding]:
    here = (*SPEC, "agents")
    reads = ((*here, "count"), (*here, "members"))
    agents = fleet.agents
    if agents.count is not None and agents.members:
        hint = f"remove `count`; the {len(agents.members)} members are counted"
        yield Finding((*here, "count"), "count and members are both given", hint, reads)
    if agents.count is None and not agents.members:
        hint = "write `count: 4`, or list the agents under `members` when they differ"
        yield Finding(here, "neither count nor members is given", hint, reads)


def _capabilities(fleet: Fleet) -> Iterator[Finding]:
    here = (*SPEC, "agents")
    reads = ((*here, "requires"), (*here, "driver"), (*here, "members"))
    for driver in sorted({agent.driver for agent in fleet.agents.resolved if agent.driver}):
        able = CAPABILITIES[driver]
        for index, capability in enumerate(fleet.agents.requires):
            if capability not in able:
                hint = f"{driver} can do {listed(sorted(able), 'and')}: remove {capability}, or use another driver"
                yield Finding((*here, "requires", index), f"the driver {driver} cannot do {capability}", hint, reads)


def _flown_context(fleet: Fleet) -> Iterator[Finding]:
    place, contexts = (*SPEC, "stateSpace", "context"), (*SPEC, "contexts")
    name = fleet.state_space.context
    names = [context.name for context in fleet.contexts]
    if name not in names:
        hint = did_you_mean(name, names, f"contexts has {listed(names, 'and')}: name one, or add {name} to contexts")
        reads = (place, *((*contexts, index, "name") for index in range(len(names))))
        yield Finding(place, f'no context is called "{name}"', hint, reads)
    elif ContextUse.MISSION not in fleet.context(name).use:
        index = names.index(name)
        use = ", ".join([*fleet.context(name).use, ContextUse.MISSION])
        message = f'"{name}" is what missions fly over, but its use is {listed(fleet.context(name).use, "and")}'
        hint = f"write `use: [{ContextUse.MISSION}]` if it is for missions only, or `use: [{use}]`"
        here = (*contexts, index)
        yield Finding((*here, "use"), message, hint, (place, (*here, "name"), (*here, "use")))


def _contexts_to_learn_from(fleet: Fleet) -> Iterator[Finding]:
    if fleet.sa.kind is SAKind.PLANNER:  # it can fly without having learned anything
        return
    here = (*SPEC, "contexts")
    given = (
        (*SPEC, "rewardShaping", "weights"),
        (*SPEC, "ha", "utilityThreshold"),
        (*SPEC, "ha", "visitedThreshold"),
    )
    values = (fleet.reward_shaping.weights, fleet.ha.utility_threshold, fleet.ha.visited_threshold)
    if not fleet.contexts_for(ContextUse.SHAPING) and any(value in (None, {}) for value in values):
        hint = (
            "add `Shaping` to the use of a context of an earlier mission, or give rewardShaping.weights, "
            "ha.utilityThreshold and ha.visitedThreshold"
        )
        yield Finding(here, "no context is for Shaping, so reward and thresholds cannot be found", hint, (here, *given))
    if not fleet.contexts_for(ContextUse.TRAINING) and fleet.sa.pretrained is None:
        hint = "add `Training` to the use of a context of an earlier mission, or give sa.pretrained"
        reads = (here, (*SPEC, "sa", "pretrained"))
        yield Finding(here, "no context is for Training, so SA cannot be trained", hint, reads)


def _planner(fleet: Fleet) -> Iterator[Finding]:
    """What the planner takes for granted."""
    if fleet.sa.kind is not SAKind.PLANNER:
        return
    kind, goals = (*SPEC, "sa", "kind"), (*SPEC, "goals")
    if fleet.accuracy_goal is None:
        hint = "add `{metric: accuracy, atLeast: 0.7}` to goals, or use another kind of SA"
        yield Finding(goals, "Planner lands when its map is accurate enough, and no goal says so", hint, (kind, goals))
    told: set[Path] = set()  # of agents that share their actions, the first says it for all
    for index, agent in enumerate(fleet.agents.resolved):
        of_member = bool(fleet.agents.members) and fleet.agents.members[index].actions is not None
        here: Path = (*SPEC, "agents", *(("members", index) if of_member else ()), "actions")
        missing = [action for action in CARDINAL if action not in (agent.actions or ())]
        if missing and here not in told:
            told.add(here)
            message = f"Planner flies along rows and columns, but {agent.name} may not move {listed(missing, 'or')}"
            yield Finding(here, message, f"add {listed(missing, 'and')}, or use another kind of SA", (kind, here))
    if fleet.eval.checks is EvalChecks.AFTER_GROUP:
        checks = (*SPEC, "eval", "checks")
        message = f"{EvalChecks.AFTER_GROUP} asks Eval() when a state group is left, and Planner has none"
        yield Finding(checks, message, f"write `checks: {EvalChecks.AT_END}`, or leave it out", (kind, checks))


def _goals(fleet: Fleet) -> Iterator[Finding]:
    for index, goal in enumerate(fleet.goals):
        yield from _goal(goal, (*SPEC, "goals", index))


def _goal(goal: Goal, here: Path) -> Iterator[Finding]:
    if goal.at_least is None and goal.at_most is None:
        hint = "write `atLeast: 0.7` if more is better, or `atMost: 0.7` if less is"
        yield Finding(here, f"the goal for {goal.metric} has no bound", hint)
    elif goal.at_least is not None and goal.at_most is not None and goal.at_least > goal.at_most:
        message = f"atLeast {goal.at_least:g} is more than atMost {goal.at_most:g}: no value meets both"
        yield Finding(here, message, f"write `atLeast: {goal.at_most:g}` and `atMost: {goal.at_least:g}`")


def _functions(fleet: Fleet) -> Iterator[Finding]:
    yield from _function(fleet.map, (*SPEC, "map"))
    yield from _function(fleet.eval, (*SPEC, "eval"))


def _function(spec: FunctionSpec, here: Path) -> Iterator[Finding]:
    reads = ((*here, "function"), (*here, "image"))
    if spec.function and spec.image:
        hint = "keep `function` for Python code beside the FleetSpec, or `image` for a container"
        yield Finding(here, "function and image are both given", hint, reads)
    if not spec.function and not spec.image:
        hint = "write `function: module:function` for Python code beside the FleetSpec, or `image: ...` for a container"
        yield Finding(here, "neither function nor image is given", hint, reads)
    if spec.command and spec.function and not spec.image:
        hint = "remove `command`, or give `image` instead of `function`"
        yield Finding((*here, "command"), "a Python function has no command", hint, (*reads, (*here, "command")))
    if duration_s(spec.timeout) == 0:
        yield Finding((*here, "timeout"), "every call would fail at once", "write a time such as 10s")


def _aggregation(fleet: Fleet) -> Iterator[Finding]:
    here = (*SPEC, "aggregation")
    kind, function = fleet.aggregation.kind, fleet.aggregation.function
    reads = ((*here, "kind"), (*here, "function"))
    if kind is AggregationKind.CUSTOM and function is None:
        hint = "write `function: module:function`: from the agents' names to a list of lists of names"
        yield Finding(here, "Custom needs a function", hint, reads)
    if kind is not AggregationKind.CUSTOM and function is not None:
        hint = "write `kind: Custom` to use the function, or remove it"
        yield Finding((*here, "function"), f"a function has no meaning with {kind or 'the default kind'}", hint, reads)
    agents = len(fleet.agents.resolved)
    if kind is AggregationKind.POWERSET and agents > POWERSET_LIMIT:
        models = f"{2**agents - 1:,}" if agents < 40 else f"2^{agents}"
        message = f"Powerset is for up to {POWERSET_LIMIT} agents: {agents} agents would need {models} models"
        hint = "write `kind: EachAndAll` or `kind: Neighbours`, or choose the subsets yourself with `kind: Custom`"
        counted = ((*SPEC, "agents", "count"), (*SPEC, "agents", "members"))
        yield Finding((*here, "kind"), message, hint, ((*here, "kind"), *counted))


def _weights(fleet: Fleet) -> Iterator[Finding]:
    weights = fleet.reward_shaping.weights
    if fleet.sa.kind is SAKind.PLANNER:
        yield from _planners_weights(weights)
    elif weights and not any(weights.values()):
        hint = "give at least one feature a weight above 0, or remove `weights` so that they are found"
        yield Finding((*SPEC, "rewardShaping", "weights"), "with all weights at 0, every state is worth the same", hint)


def _planners_weights(weights: Mapping[str, float]) -> Iterator[Finding]:
    here, names = (*SPEC, "rewardShaping", "weights"), list(BELIEVED)
    for name in weights:
        if name not in names:
            hint = did_you_mean(name, names, f"a Planner weighs {listed(names, 'and')}")
            yield Finding(
                (*here, name), f"a Planner does not weigh {name}", hint, ((*here, name), (*SPEC, "sa", "kind"))
            )
    if not any(weights.get(name, 1.0) for name in names):
        hint = "give at least one of them a weight above 0"
        yield Finding(here, "with all weights at 0, every state is worth the same", hint)


def _storage(fleet: Fleet) -> Iterator[Finding]:
    uri, here = fleet.storage.uri, (*SPEC, "storage", "uri")
    if uri is None or re.search(STORAGE_ADDRESS, uri):
        return
    parts = urlsplit(uri)
    if not parts.scheme:
        hint = f"write `file://{uri}`" if uri.startswith("/") else f"write {STORAGE_EXAMPLES}"
        yield Finding(here, f'"{uri}" does not say which kind of storage it is', hint)
    elif parts.scheme in {"hdfs", "swebhdfs"}:
        hint = f"write `webhdfs://{parts.hostname or 'namenode'}:9870{parts.path or '/fleet'}`: HDFS over HTTP"
        yield Finding(here, f"{parts.scheme}:// is not spoken here", hint)
    else:
        yield Finding(here, f'"{uri}" is no address of a storage', f"write {STORAGE_EXAMPLES}")


def _mission_plan(fleet: Fleet) -> Iterator[Finding]:
    here = (*SPEC, "missions")
    if fleet.missions.schedule is not None and duration_s(fleet.missions.interval) > 0:
        reads = ((*here, "schedule"), (*here, "interval"))
        hint = "keep `schedule` for times of the clock, or `interval` for a time between missions"
        yield Finding((*here, "interval"), "interval and schedule are both given", hint, reads)


def _resources(fleet: Fleet) -> Iterator[Finding]:
    workflow = (*SPEC, "workflow")
    places: tuple[tuple[Path, Resources], ...] = (
        ((*SPEC, "map", "resources"), fleet.map.resources),
        ((*SPEC, "eval", "resources"), fleet.eval.resources),
        ((*SPEC, "aggregation", "resources"), fleet.aggregation.resources),
        ((*workflow, "resources"), fleet.workflow.resources),
        ((*workflow, "sensorResources"), fleet.workflow.sensor_resources),
        ((*workflow, "trainerResources"), fleet.workflow.trainer_resources),
    )
    for here, resources in places:
        yield from _amounts(resources.requests, (*here, "requests"))
        yield from _amounts(resources.limits, (*here, "limits"))
        yield from _within_limits(resources, here)
    shared = Amounts(cpu=fleet.scheduling.cpu, memory=fleet.scheduling.memory)
    yield from _amounts(shared, (*SPEC, "scheduling"))


def _amounts(amounts: Amounts, here: Path) -> Iterator[Finding]:
    memory, cpu = amounts.memory, amounts.cpu
    if memory is not None and quantity_value(memory) < LEAST_MEMORY:
        number = memory.rstrip("mkKi")
        message = f"{memory} of memory is {quantity_value(memory):g} bytes, and no program runs in that"
        yield Finding((*here, "memory"), message, f"write {number}Mi for mebibytes")
    if cpu is not None and quantity_value(cpu) > MOST_CPU:
        message = f"{cpu} of CPU is {quantity_value(cpu):,.0f} cores"
        yield Finding((*here, "cpu"), message, "write cores as 2, or thousandths of a core as 500m")


def _within_limits(resources: Resources, here: Path) -> Iterator[Finding]:
    for name in ("cpu", "memory"):
        request, limit = getattr(resources.requests, name), getattr(resources.limits, name)
        if request is not None and limit is not None and quantity_value(request) > quantity_value(limit):
            reads = ((*here, "requests", name), (*here, "limits", name))
            message = f"the request of {request} is more than the limit of {limit}"
            yield Finding(reads[0], message, f"write at most {limit} here, or raise limits.{name}", reads)


def _edge_node(node: EdgeNode) -> Iterator[Finding]:
    spec = node.spec
    if spec.busy_watts < spec.idle_watts:
        message = f"a busy machine would draw less ({spec.busy_watts:g} W) than an idle one ({spec.idle_watts:g} W)"
        reads = ((*SPEC, "busyWatts"), (*SPEC, "idleWatts"))
        yield Finding(reads[0], message, f"write at least {spec.idle_watts:g}", reads)
    if duration_s(spec.boot_time) == 0:
        yield Finding((*SPEC, "bootTime"), "no machine is ready at once", "write the time that it takes, such as 60s")
    if int(spec.mac[:2], 16) % 2 or spec.mac == "00:00:00:00:00:00":
        hint = "write the address of the machine's network card, as `ip link` shows it"
        yield Finding((*SPEC, "mac"), f"{spec.mac} is not the address of one machine", hint)


FLEET_RULES: tuple[Callable[[Fleet], Iterator[Finding]], ...] = (
    _agents,
    _capabilities,
    _flown_context,
    _contexts_to_learn_from,
    _planner,
    _goals,
    _functions,
    _aggregation,
    _weights,
    _storage,
    _mission_plan,
    _resources,
)
"""Each takes a fleet whose parts are sound, and tells what is wrong between them."""

"""What is allowed in a FleetSpec and yet probably not meant."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator

from fleet.spec.base import ABSOLUTE_LIMIT
from fleet.spec.findings import Finding, listed
from fleet.spec.functions import ContextUse
from fleet.spec.learning import SAKind, WeightLearner
from fleet.spec.platform import UsefulnessScale
from fleet.spec.resources import Fleet, FleetSpec
from fleet.spec.rules import SPEC
from fleet.spec.yaml_text import Path

FROM_REPLAYS_ALONE = frozenset({WeightLearner.MULTIPLICATIVE_WEIGHTS, WeightLearner.BEST_BY_REPLAY})
SHARES = frozenset({"accuracy", "coverage"})
"""Metrics of the built-in Eval parts that are shares from 0 to 1."""


def doubts(spec: FleetSpec) -> list[Finding]:
    """Everything doubtful in a FleetSpec whose rules hold."""
    return [finding for rule in DOUBTS for finding in rule(spec.spec)]


def _answers_seen(fleet: Fleet) -> Iterator[Finding]:
    """Learning must not see what missions are measured on."""
    flown = {context.uri: context.name for context in fleet.contexts_for(ContextUse.MISSION)}
    for index, context in enumerate(fleet.contexts):
        learning = [use for use in context.use if use is not ContextUse.MISSION]
        if context.uri in flown and learning:
            here = (*SPEC, "contexts", index, "use")
            other = flown[context.uri]
            what = "it" if other == context.name else f'the same data, as "{other}",'
            message = f'"{context.name}" is for {listed(learning, "and")}, and {what} is flown over too'
            hint = "learning sees the answers, so results say little of a new place; learn from other contexts"
            yield Finding(here, message, hint, ((*SPEC, "contexts"),))


def _same_data(fleet: Fleet) -> Iterator[Finding]:
    first: dict[str, str] = {}
    flown = {context.uri for context in fleet.contexts_for(ContextUse.MISSION)}
    for index, context in enumerate(fleet.contexts):
        if context.uri in first and context.uri not in flown:
            message = f'"{context.name}" and "{first[context.uri]}" are the same data'
            yield Finding((*SPEC, "contexts", index, "uri"), message, "give one context both uses, or another uri")
        first.setdefault(context.uri, context.name)


def _deep_models(fleet: Fleet) -> Iterator[Finding]:
    here = (*SPEC, "sa", "kind")
    if fleet.sa.kind in {SAKind.DQN, SAKind.DDPG}:
        yield Finding(here, f"{fleet.sa.kind} needs the extra `deep`", "install it: pip install 'fleet-computer[deep]'")
    if fleet.sa.kind is SAKind.DDPG:
        message = "DDPG is made for continuous actions; here it gives each of the eight moves a score"
        yield Finding(here, message, "QLearning and DQN are made for such moves")


def _other_kinds_fields(fleet: Fleet) -> Iterator[Finding]:
    """What is given, and not looked at by this kind of SA."""
    planned = fleet.sa.kind is SAKind.PLANNER
    of_groups = {"utilityThreshold": fleet.ha.utility_threshold, "visitedThreshold": fleet.ha.visited_threshold}
    of_planner = {"caution": fleet.ha.caution}
    for name, value in (of_groups if planned else of_planner).items():
        if value is not None:
            message = f"{fleet.sa.kind} does not look at {name}"
            yield Finding((*SPEC, "ha", name), message, "remove it", ((*SPEC, "ha", name), (*SPEC, "sa", "kind")))
    if fleet.sa.feature is not None and not planned:
        here = (*SPEC, "sa", "feature")
        yield Finding(here, f"{fleet.sa.kind} does not look at feature", "remove it", (here, (*SPEC, "sa", "kind")))


def _levels(fleet: Fleet) -> Iterator[Finding]:
    agents = len(fleet.agents.resolved)
    if fleet.scheduling.usefulness is UsefulnessScale.ABSOLUTE and agents > ABSOLUTE_LIMIT:
        message = f"with {agents} agents, Absolute puts nearly every model at level 0, where none is retrained"
        hint = "write `usefulness: Relative`, or leave it out"
        reads: tuple[Path, ...] = ((*SPEC, "scheduling", "usefulness"), (*SPEC, "agents"))
        yield Finding((*SPEC, "scheduling", "usefulness"), message, hint, reads)


def _never_happens(fleet: Fleet) -> Iterator[Finding]:
    count, every = fleet.missions.count, fleet.online_learning.retraining.every
    pruning = fleet.aggregation.pruning
    missions = (*SPEC, "missions", "count")
    if every > count:
        here = (*SPEC, "onlineLearning", "retraining", "every")
        message = f"models are retrained after every {every} missions, and there are only {count}"
        yield Finding(here, message, f"write at most {count}, or plan more missions", (here, missions))
    if pruning.below > 0 and pruning.after >= count > 1:
        here = (*SPEC, "aggregation", "pruning", "after")
        message = f"no model is pruned: that takes {pruning.after} missions, and there are only {count}"
        yield Finding(here, message, f"write less than {count}, or plan more missions", (here, missions))
    batch, epochs = fleet.reward_shaping.batch, fleet.reward_shaping.epochs
    if batch > epochs:
        here = (*SPEC, "rewardShaping", "batch")
        message = f"{batch} parameter sets are simulated side by side, and there are only {epochs} epochs"
        reads = (here, (*SPEC, "rewardShaping", "epochs"))
        yield Finding(here, message, f"write at most {epochs}, or more epochs", reads)


def _frozen_weights(fleet: Fleet) -> Iterator[Finding]:
    learning = fleet.online_learning
    if learning.weights in FROM_REPLAYS_ALONE and learning.replays == 0:
        here = (*SPEC, "onlineLearning", "replays")
        message = f"{learning.weights} learns from replays alone; without them every agent keeps its first model"
        hint = "leave `replays` out, or write `weights: Uniform`"
        yield Finding(here, message, hint, (here, (*SPEC, "onlineLearning", "weights")))


def _percent(fleet: Fleet) -> Iterator[Finding]:
    for index, goal in enumerate(fleet.goals):
        for name, bound in (("atLeast", goal.at_least), ("atMost", goal.at_most)):
            if goal.metric in SHARES and bound is not None and bound > 1:
                message = f"{goal.metric} is a share from 0 to 1 unless Eval() says otherwise, and this is {bound:g}"
                hint = f"write {bound / 100:g} for {bound:g} %" if bound <= 100 else ""
                yield Finding((*SPEC, "goals", index, name), message, hint)


def _same_start(fleet: Fleet) -> Iterator[Finding]:
    at: dict[tuple[int, int], list[int]] = defaultdict(list)
    for index, agent in enumerate(fleet.agents.members):
        if agent.start is not None:
            at[agent.start.row, agent.start.column].append(index)
    for (row, column), members in at.items():
        if len(members) > 1:
            names = listed([fleet.agents.members[index].name for index in members], "and")
            message = f"{names} take off from the same cell (row {row}, column {column})"
            yield Finding((*SPEC, "agents", "members", members[1], "start"), message, "give each its own cell")


def _loose_image(fleet: Fleet) -> Iterator[Finding]:
    for name, function in (("map", fleet.map), ("eval", fleet.eval)):
        tag = (function.image or "").rpartition("/")[2].partition(":")[2]
        if function.image and "@" not in function.image and tag in {"", "latest"}:
            message = f"{function.image} may be another program tomorrow"
            yield Finding((*SPEC, name, "image"), message, "name a version, as in my-map:1.2")


DOUBTS: tuple[Callable[[Fleet], Iterator[Finding]], ...] = (
    _answers_seen,
    _same_data,
    _deep_models,
    _other_kinds_fields,
    _levels,
    _never_happens,
    _frozen_weights,
    _percent,
    _same_start,
    _loose_image,
)
"""Each takes a fleet whose rules hold."""

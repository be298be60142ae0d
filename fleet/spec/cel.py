"""Rules between fields that Kubernetes checks by itself, in its Common Expression Language.

Each has its counterpart in `rules`, which says more: where, and what to write instead. The API server tries the rules
also on the defaults in the schema as they stand there, before the defaults inside of them are filled in: a rule asks
`has(...)` of what has a default too. Fields that are named like a reserved word of the language are written between
double underscores: `self.__function__`.
Source: Kubernetes, "Extend the Kubernetes API with CustomResourceDefinitions", validation rules.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fleet.spec.base import POWERSET_LIMIT
from fleet.spec.learning import BELIEVED
from fleet.spec.platform import STORAGE_ADDRESS, STORAGE_EXAMPLES
from fleet.spec.swarm import CAPABILITIES, CARDINAL, Capability


@dataclass(frozen=True)
class CelRule:
    """One rule; it holds when `rule` is true of `self` (and `oldSelf`, what it was before)."""

    rule: str
    message: str

    @property
    def document(self) -> dict[str, str]:
        """The rule as a CRD has it."""
        return {"rule": self.rule, "message": self.message}


def _within(amount: str) -> CelRule:
    limit, request = f"self.limits.{amount}", f"self.requests.{amount}"
    given = f"has(self.limits) && has(self.requests) && has({limit}) && has({request})"
    return CelRule(
        f"!({given}) || !quantity(string({request})).isGreaterThan(quantity(string({limit})))",
        f"requests.{amount} must not be more than limits.{amount}",
    )


_MEMBERS = "(has(self.members) && size(self.members) > 0)"


def _driver_rules() -> tuple[CelRule, ...]:
    """One rule for each driver that cannot do everything that a mission may demand."""
    rules = []
    for driver, able in CAPABILITIES.items():
        missing = [capability.value for capability in Capability if capability not in able]
        if missing:
            uses = (
                f"({_MEMBERS} ? self.members.exists(m, (has(m.driver) ? m.driver : self.driver) == '{driver}') "
                f": self.driver == '{driver}')"
            )
            rules.append(
                CelRule(
                    f"!has(self.requires) || !self.requires.exists(r, r in {missing}) || !{uses}",
                    f"the driver {driver} cannot do {', '.join(missing)}: change requires, or use another driver",
                )
            )
    return tuple(rules)


def _all_cardinal(of: str) -> str:
    return f"{[action.value for action in CARDINAL]}.all(a, a in {of}.actions)"


_SHARED_MOVES = f"(!has(self.agents.actions) || {_all_cardinal('self.agents')})"
_AGENTS_CAN_TURN = (
    "(has(self.agents.members) && size(self.agents.members) > 0 ? "
    f"self.agents.members.all(m, has(m.actions) ? {_all_cardinal('m')} : {_SHARED_MOVES}) : {_SHARED_MOVES})"
)
_AGENTS = "(has(self.agents.count) ? self.agents.count : has(self.agents.members) ? size(self.agents.members) : 0)"
_FUNCTION = (
    CelRule("has(self.__function__) != has(self.image)", "give either function or image, and not both"),
    CelRule(
        "!has(self.command) || size(self.command) == 0 || has(self.image)",
        "command is for an image; a function has none",
    ),
    CelRule("self.timeout.matches('[1-9]')", "timeout must be more than 0s"),
)

_AMOUNTS = (
    CelRule(
        "!has(self.memory) || !quantity(string(self.memory)).isLessThan(quantity('1Mi'))",
        "memory is in bytes, and less than 1Mi can hold no program: write 256Mi, not 256 or 256m",
    ),
    CelRule(
        "!has(self.cpu) || !quantity(string(self.cpu)).isGreaterThan(quantity('1k'))",
        "cpu is in cores, and no machine has more than 1000: write 500m or 2",
    ),
)

RULES: Mapping[str, tuple[CelRule, ...]] = {
    "Amounts": _AMOUNTS,
    "Scheduling": _AMOUNTS,
    "Resources": (_within("cpu"), _within("memory")),
    "Agents": (
        CelRule(f"has(self.count) != {_MEMBERS}", "give either count or members, and not both"),
        CelRule(
            "has(self.count) == has(oldSelf.count) && (!has(self.count) || self.count == oldSelf.count)",
            "the number of agents cannot change: models and their weights are kept by subset of the agents. "
            "Make a new FleetSpec",
        ),
        CelRule(
            "!has(self.members) || !has(oldSelf.members) || "
            "self.members.map(m, m.name) == oldSelf.members.map(m, m.name)",
            "the names and the order of the agents cannot change: models and their weights are kept by subset of the "
            "agents. Make a new FleetSpec",
        ),
        *_driver_rules(),
    ),
    "StateSpace": (
        CelRule(
            "self.groups.rows == oldSelf.groups.rows && self.groups.columns == oldSelf.groups.columns",
            "the size of state groups cannot change: reward shaping found the thresholds of HA for this size. "
            "Make a new FleetSpec",
        ),
    ),
    "Goal": (
        CelRule("has(self.atLeast) || has(self.atMost)", "give atLeast, atMost, or both"),
        CelRule(
            "!has(self.atLeast) || !has(self.atMost) || self.atLeast <= self.atMost",
            "atLeast must not be more than atMost: no value could meet both",
        ),
    ),
    "MapSpec": _FUNCTION,
    "EvalSpec": _FUNCTION,
    "SASpec": (
        CelRule(
            "!has(self.kind) || self.kind == oldSelf.kind",
            "the kind of SA cannot change: the models that are there are of this kind. Make a new FleetSpec",
        ),
    ),
    "Aggregation": (
        CelRule(
            "(has(self.kind) && self.kind == 'Custom') == has(self.__function__)",
            "function is needed with kind Custom, and has no meaning with another kind",
        ),
    ),
    "StorageSpec": (
        CelRule(
            f"!has(self.uri) || self.uri.matches('{STORAGE_ADDRESS}')",
            f"uri must be an address of a storage, as {STORAGE_EXAMPLES}",
        ),
        CelRule(
            "has(self.uri) == has(oldSelf.uri) && (!has(self.uri) || self.uri == oldSelf.uri)",
            "the storage cannot change: records and models are there. Make a new FleetSpec",
        ),
    ),
    "Fleet": (
        CelRule(
            "self.contexts.exists(c, c.name == self.stateSpace.context && 'Mission' in c.use)",
            "stateSpace.context must be the name of one of contexts that has Mission in its use",
        ),
        CelRule(
            "self.contexts.exists(c, 'Shaping' in c.use) || "
            "has(self.rewardShaping.weights) && size(self.rewardShaping.weights) > 0 && "
            "has(self.ha.utilityThreshold) && has(self.ha.visitedThreshold) || "
            "self.sa.kind == 'Planner'",
            "one of contexts must have Shaping in its use, or rewardShaping.weights, ha.utilityThreshold and "
            "ha.visitedThreshold must all be given",
        ),
        CelRule(
            "self.contexts.exists(c, 'Training' in c.use) || has(self.sa.pretrained) || self.sa.kind == 'Planner'",
            "one of contexts must have Training in its use, or sa.pretrained must be given",
        ),
        CelRule(
            "self.sa.kind == 'Planner' || !has(self.rewardShaping.weights) || size(self.rewardShaping.weights) == 0 || "
            "self.rewardShaping.weights.exists(f, self.rewardShaping.weights[f] > 0.0)",
            "at least one weight must be more than 0: with all at 0, every state is worth the same",
        ),
        CelRule(
            "self.sa.kind != 'Planner' || !has(self.rewardShaping.weights) || "
            f"self.rewardShaping.weights.all(f, f in {list(BELIEVED)})",
            f"a Planner weighs {', '.join(BELIEVED)}, and nothing else",
        ),
        CelRule(
            "self.sa.kind != 'Planner' || self.goals.exists(g, g.metric == 'accuracy' && has(g.atLeast))",
            "Planner lands when its map is accurate enough: one of goals must be for accuracy, with atLeast",
        ),
        CelRule(
            f"self.sa.kind != 'Planner' || {_AGENTS_CAN_TURN}",
            "Planner flies along rows and columns: every agent must have North, South, East and West in its actions",
        ),
        CelRule(
            "self.sa.kind != 'Planner' || self.eval.checks != 'AfterGroup'",
            "AfterGroup asks Eval() when a state group is left, and Planner has none: write AtEnd",
        ),
        CelRule(
            f"!has(self.aggregation.kind) || self.aggregation.kind != 'Powerset' || {_AGENTS} <= {POWERSET_LIMIT}",
            f"Powerset is for up to {POWERSET_LIMIT} agents: write EachAndAll, Neighbours or Custom",
        ),
    ),
    "MissionPlan": (
        CelRule(
            "!has(self.schedule) || !has(self.interval) || !self.interval.matches('[1-9]')",
            "give either interval or schedule, and not both",
        ),
    ),
    "MissionSpec": (CelRule("self == oldSelf", "a Mission never changes: make a new one"),),
    "EdgeNodeSpec": (
        CelRule("self.busyWatts >= self.idleWatts", "busyWatts must be at least idleWatts"),
        CelRule("self.bootTime.matches('[1-9]')", "bootTime must be more than 0s"),
        CelRule("self.node == oldSelf.node", "node cannot change: another machine is another EdgeNode"),
    ),
}
"""Rules by the name of the model that they are true of; `self` is one value of that model."""

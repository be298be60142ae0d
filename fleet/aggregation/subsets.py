"""Which subsets of the agents retrain a model each.

The subsets bound SA_s of the paper: all members of the powerset but the empty one, or what a heuristic names. The
empty member is the model of the first training.
Source: paper, section "Bayesian optimization for system-level hyperparameters".
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

from pydantic import Field

from fleet.errors import CallSite, FunctionError, ObjectNotFound, Problem, SpecError
from fleet.functions.resolve import resolve
from fleet.spec.base import POWERSET_LIMIT, Model
from fleet.spec.platform import AggregationKind
from fleet.spec.resources import Fleet
from fleet.storage.layout import FleetPaths
from fleet.storage.port import Storage

LONGEST_KEY = 20
"""Keys are a part of object names, which are DNS labels."""
MOST_NUMBERS = 8
MOST_SUBSETS = 2**POWERSET_LIMIT - 1
"""No heuristic may start more aggregators than the largest powerset does."""


@dataclass(frozen=True)
class Subset:
    """Agents whose records retrain one model together.

    Args:
        agents: Their names, in the order of the fleet.
        key: Short name of the subset, the same in every mission; see `key_of`.
    """

    agents: tuple[str, ...]
    key: str


class SubsetsDocument(Model):
    """subsets.json: what the user's own aggregation answered."""

    function: str
    subsets: dict[str, tuple[str, ...]] = Field(description="Agents by the key of the subset.")


def key_of(numbers: Sequence[int], agents: int) -> str:
    """The key of a subset: the agents' numbers, or "all", or a hash, when these would be too long.

    Args:
        numbers: Numbers of the subset's agents, from 1, ascending.
        agents: How many agents the fleet has.
    Returns:
        At most 20 lower-case letters, digits and "-", beginning and ending with a letter or digit.
    """
    plain = "-".join(map(str, numbers))
    if len(numbers) <= MOST_NUMBERS and len(plain) <= LONGEST_KEY:
        return plain
    if len(numbers) == agents:
        return "all"
    return f"h{hashlib.blake2b(plain.encode(), digest_size=8).hexdigest()}"


def subsets_for(fleet: Fleet) -> tuple[Subset, ...]:
    """The subsets that a FleetSpec aggregates, each once.

    Raises:
        SpecError: the powerset is asked for and too large, or no function is named for Custom.
        FunctionError: the user's function failed, or did not answer subsets of the agents.
    """
    names = [agent.name for agent in fleet.agents.resolved]
    chosen: Iterable[Sequence[int]]
    match fleet.aggregation_kind:
        case AggregationKind.POWERSET:
            chosen = _powerset(len(names))
        case AggregationKind.EACH_AND_ALL:
            chosen = _each_and_all(len(names))
        case AggregationKind.NEIGHBOURS:
            chosen = _neighbours(len(names))
        case AggregationKind.CUSTOM:
            chosen = _custom(fleet.aggregation.function, names)
    numbers = dict.fromkeys(tuple(sorted(subset)) for subset in chosen)
    return tuple(
        Subset(tuple(names[index] for index in subset), key_of([index + 1 for index in subset], len(names)))
        for subset in numbers
    )


def write_subsets(fleet: Fleet, storage: Storage, paths: FleetPaths) -> None:
    """Ask the user's own aggregation, and keep what it answers for those who must not run it; nothing for the others.

    Raises:
        FunctionError: as `subsets_for`.
    """
    if fleet.aggregation_kind is not AggregationKind.CUSTOM:
        return
    asked = SubsetsDocument(
        function=fleet.aggregation.function or "", subsets={each.key: each.agents for each in subsets_for(fleet)}
    )
    data = asked.model_dump_json(by_alias=True, indent=1).encode()
    try:
        if storage.read(paths.subsets) == data:
            return
    except ObjectNotFound:
        pass
    storage.write(paths.subsets, data)


def known_subsets(fleet: Fleet, storage: Storage, paths: FleetPaths) -> tuple[Subset, ...] | None:
    """The subsets of a fleet, without running anything of the user's.

    Returns:
        None when the user's own aggregation is not known yet: a trainer asks it.
    """
    if fleet.aggregation_kind is not AggregationKind.CUSTOM:
        return subsets_for(fleet)
    try:
        document = SubsetsDocument.model_validate_json(storage.read(paths.subsets))
    except ObjectNotFound:
        return None
    if document.function != fleet.aggregation.function:
        return None
    return tuple(Subset(agents, key) for key, agents in document.subsets.items())


def _powerset(agents: int) -> Iterable[tuple[int, ...]]:
    if agents > POWERSET_LIMIT:
        message = f"the powerset of {agents} agents has {2**agents - 1} members; it goes up to {POWERSET_LIMIT} agents"
        raise SpecError([Problem("spec.aggregation.kind", message, "write EachAndAll, Neighbours or Custom")])
    return (subset for size in range(1, agents + 1) for subset in combinations(range(agents), size))


def _each_and_all(agents: int) -> Iterable[tuple[int, ...]]:
    return [*((index,) for index in range(agents)), tuple(range(agents))]


def _neighbours(agents: int) -> Iterable[tuple[int, ...]]:
    """Each agent with those whose part of the state groups comes before and after its own in the order of visit."""
    return [tuple(range(max(0, index - 1), min(agents, index + 2))) for index in range(agents)]


def _custom(reference: str | None, names: Sequence[str]) -> list[list[int]]:
    if reference is None:
        problem = Problem("spec.aggregation.function", "is missing", "Custom needs `module:function`")
        raise SpecError([problem])
    site = CallSite(reference)
    function = resolve(reference)
    try:
        answer = function(list(names))
    except Exception as error:  # the function is the user's: it may raise anything
        raise FunctionError(f"raised {type(error).__name__}: {error}", site) from error
    if not isinstance(answer, list | tuple) or not answer:
        raise FunctionError(f"answered {answer!r:.80}; it must answer a list of lists of agents' names", site)
    if len(answer) > MOST_SUBSETS:
        raise FunctionError(f"answered {len(answer)} subsets; at most {MOST_SUBSETS} are aggregated", site)
    return [_indices(subset, names, site) for subset in answer]


def _indices(subset: object, names: Sequence[str], site: CallSite) -> list[int]:
    if not isinstance(subset, list | tuple) or not subset:
        raise FunctionError(f"answered a subset {subset!r:.80}; a subset is a list of at least one agent's name", site)
    strange = [name for name in subset if name not in names]
    if strange:
        raise FunctionError(f"answered {strange[0]!r:.80}, which is no agent; agents: {', '.join(names)}", site)
    if len(set(subset)) < len(subset):
        raise FunctionError(f"answered the subset {subset!r:.80}, which has an agent twice", site)
    return [names.index(name) for name in subset]

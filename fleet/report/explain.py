"""Why an agent did what it did in a step of a flown mission: its log lived again, and each decision told.

Nothing is decided here: the same mind that flew lives the log again, and says from what it decided.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import islice
from typing import TYPE_CHECKING, TypeVar

from pydantic import ValidationError

from fleet.errors import MissionError, ObjectNotFound
from fleet.missions.flight import LAND, GroupHistory
from fleet.missions.layout import MOVES
from fleet.missions.records import Record, read_log, records_after_gap
from fleet.report.collect import mission_numbers
from fleet.runtime.group_mind import GroupMind, GroupThought
from fleet.runtime.mind import Mind, open_mind
from fleet.runtime.remembering import stored_environment
from fleet.runtime.settings import Settings

if TYPE_CHECKING:
    from fleet.report.explain_scout import ScoutExplanation

Read = TypeVar("Read")


class Reason(StrEnum):
    """Why a move was made."""

    HIGHEST_SCORE = "HighestScore"
    EXPLORATION = "Exploration"
    TRAVEL_IN_GROUP = "TravelInGroup"
    TRAVEL_TO_GROUP = "TravelToGroup"
    ALL_GROUPS_EXPLORED = "AllGroupsExplored"
    EVAL_FINISHED = "EvalFinished"


@dataclass(frozen=True)
class GroupState:
    """A state group after this step, and HA's answer about it.

    Args:
        number: 1 for the first group of the agent's part.
        history: U, V and the number of its states.
        useful_enough, seen_enough: U > T_u, and V > T_v.
        is_left: Whether the agent is done with it.
    """

    number: int
    history: GroupHistory
    useful_enough: bool
    seen_enough: bool
    is_left: bool


@dataclass(frozen=True, eq=False)
class Explanation:
    """One step of a log and why.

    Args:
        record: The step, as the log has it.
        group_of_cell: The cell's group as an index into the layout's; -1 when the cell has no data.
        groups: The group that was explored on arrival, and those after it up to the one that is explored now.
        groups_of_agent: How many groups the agent's part has.
        thresholds: T_u and T_v.
        ssv: What was captured, by feature; empty when nothing was.
        asked_ha: Whether HA was asked; not on the way to a cell.
        finished: What Eval() said here; None when it was not asked.
        legal: Moves that SA could choose, as indices into MOVES; none when it was not asked.
        scores: Of each model that has a weight, by model and move; empty when SA was not asked.
        blended: The same as one, by move.
        weights: Of these models.
        reason: Why the move was made.
        target: Row and column of the cell that the agent travels to; None when it does not.
    """

    record: Record
    group_of_cell: int
    groups: tuple[GroupState, ...]
    groups_of_agent: int
    thresholds: tuple[float, int]
    ssv: Mapping[str, float]
    asked_ha: bool
    finished: bool | None
    legal: tuple[int, ...]
    scores: Mapping[str, Mapping[int, float]]
    blended: Mapping[int, float]
    weights: Mapping[str, float]
    reason: Reason
    target: tuple[int, int] | None


@dataclass(frozen=True, eq=False)
class FlownLog:
    """An agent's log of a mission, and the mind that can live it again.

    Args:
        records: The log up to the first step that is missing.
        lost: Records after that step; 0 in a log that is whole.
    """

    context: str
    records: tuple[Record, ...]
    lost: int
    mind: Mind

    @property
    def has_landed(self) -> bool:
        """Whether the log goes up to the landing."""
        return self.records[-1].move == LAND

    @property
    def plans(self) -> bool:
        """Whether the agent planned over the whole field; then `explain_scout` explains it, else `explain`."""
        return not isinstance(self.mind, GroupMind)

    def explain(self, step: int | None = None) -> tuple[Explanation, ...]:
        """One step, or all of them; can be asked once.

        Raises:
            MissionError: the log is not what this run's FleetSpec, seed and models give, or the agent planned.
        """
        mind = self.mind
        if not isinstance(mind, GroupMind):
            raise MissionError("the agent did not fly through state groups")
        lived = (_explanation(mind, record, mind.relive(record)) for record in self.records)
        return tuple(lived) if step is None else tuple(islice(lived, step, step + 1))

    def explain_scout(self, step: int | None = None) -> tuple[ScoutExplanation, ...]:
        """The same of an agent that planned."""
        from fleet.report.explain_scout import explained  # noqa: PLC0415 - loads scipy and numba
        from fleet.runtime.scout_mind import ScoutMind  # noqa: PLC0415 - likewise

        mind = self.mind
        if not isinstance(mind, ScoutMind):
            raise MissionError("the agent flew through state groups")
        found = []
        for record in self.records:
            thought = mind.relive(record)
            if step is None or record.step == step:
                found.append(explained(mind, record, thought))
            if record.step == step:
                break
        return tuple(found)


def agents_of(settings: Settings) -> list[str]:
    """Names of the run's agents, in order.

    Raises:
        MissionError: the FleetSpec of the run is missing, or cannot be read.
    """
    return [agent.name for agent in _opened("the FleetSpec of the run", lambda: settings.fleet).agents.resolved]


def flights_of(settings: Settings) -> list[int]:
    """Numbers of the missions of which the agent has a log, ascending."""
    storage, paths = settings.storage, settings.paths
    numbers = sorted(mission_numbers(storage, paths))
    return [number for number in numbers if storage.exists(paths.log(number, settings.agent))]


def open_log(settings: Settings) -> FlownLog:
    """An agent's log, and what it flew with.

    Args:
        settings: Of the storage, the fleet, the mission and the agent.
    Raises:
        MissionError: something that the agent flew with is missing, or cannot be read.
    """
    storage, paths, number = settings.storage, settings.paths, settings.mission
    of = f"of {settings.agent} in mission {number}"
    data = _opened(f"the log {of}", lambda: storage.read(paths.log(number, settings.agent)))
    records = read_log(data)
    if not records:
        raise MissionError(f"the log {of} has no step that can be read; it is empty or damaged")
    order = _opened(f"the plan of mission {number}", lambda: settings.order)
    place = f"the place of mission {number}"
    environment = _opened(place, lambda: stored_environment(settings))
    mind = _opened(f"what {settings.agent} flew mission {number} with", lambda: open_mind(settings, environment))
    return FlownLog(order.context, records, records_after_gap(data), mind)


def _opened(what: str, read: Callable[[], Read]) -> Read:
    try:
        return read()
    except ObjectNotFound as error:
        raise MissionError(f"{what} is not whole: {error}; without it no step can be explained") from error
    except (ValidationError, ValueError, KeyError, TypeError) as error:
        first = next(iter(str(error).splitlines()), type(error).__name__)
        raise MissionError(f"{what} cannot be read: {first}; without it no step can be explained") from error


def _explanation(mind: GroupMind, record: Record, thought: GroupThought) -> Explanation:
    layout, agent = mind.flight.layout, mind.flight.agent
    first, last = layout.parts[agent]
    legal = tuple(move for move in range(len(MOVES)) if thought.arrival.legal >> move & 1)
    group_of_cell = int(layout.group_of[record.cell])
    return Explanation(
        record=record,
        group_of_cell=group_of_cell,
        groups=tuple(_group(mind, one, one.group - first + 1) for one in thought.histories),
        groups_of_agent=last - first,
        thresholds=(mind.ha.utility_threshold, mind.ha.visited_threshold),
        ssv=dict(zip(mind.reward.features, record.ssv, strict=True)) if record.captured else {},
        asked_ha=thought.passing_to is None,
        finished=thought.arrival.finished,
        legal=legal,
        scores={key: {move: float(row[move]) for move in legal} for key, row in thought.scores.items()},
        blended={move: thought.blended[move] for move in legal},
        weights=mind.weights if legal else {},
        reason=_reason(thought, in_group=group_of_cell == thought.histories[-1].group),
        target=None if thought.target is None else layout.grid.position(thought.target),
    )


def _group(mind: GroupMind, history: GroupHistory, number: int) -> GroupState:
    return GroupState(
        number=number,
        history=history,
        useful_enough=mind.ha.is_useful_enough(history.utility),
        seen_enough=mind.ha.is_seen_enough(history.visited),
        is_left=history.group < mind.flight.group,
    )


def _reason(thought: GroupThought, in_group: bool) -> Reason:
    if thought.choice is not None:
        return Reason.EXPLORATION if thought.choice.explores else Reason.HIGHEST_SCORE
    if thought.decision.move == LAND:
        return Reason.EVAL_FINISHED if thought.arrival.finished else Reason.ALL_GROUPS_EXPLORED
    return Reason.TRAVEL_IN_GROUP if in_group else Reason.TRAVEL_TO_GROUP

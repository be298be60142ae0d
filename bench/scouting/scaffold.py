"""Missions in the paper's scaffold, and the same with one of its parts taken away.

Agents fly the state groups of their parts in serpentine order and land when all are explored; then the map is judged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from bench.scouting.fields import Field
from bench.scouting.flight import ENERGY, thorough_j
from bench.scouting.judge import How, accuracies
from bench.scouting.lessons import QUANTITY, Course, Learned, fleet_of, learn, terrain
from fleet.learning.models import blank_model
from fleet.learning.reward import Normaliser, RewardModel
from fleet.learning.score_tables import ALONE, NEVER, Flights, batch_of, score_table
from fleet.missions.documents import INITIAL
from fleet.simulator.batch import Flown, fly

WEIGHED_AT = 4
"""Agents with which equal weights are compared: thresholds are shaped again for them, and SA is trained again."""
HOVERING = replace(ENERGY, hovering=True)
"""What flights cost when aircraft hover from the picture to the decision."""


class Arm(StrEnum):
    """The paper's swarm, and what is left of it without a part."""

    PAPER = "paper"
    RANDOM_MOVES = "random moves, same thresholds"
    FIXED_V = "fixed V, same share of cells"
    EQUAL_WEIGHTS = "equal weights, shaped thresholds"
    NO_SHAPING = "no reward shaping: start values"


class Outcome(NamedTuple):
    """What became of a mission.

    Args:
        nm, kr: Accuracy of the map, by neighbour mean and by kriging.
        cells: Share of the cells that were captured.
        energy: E, as in `bench.scouting.judge`; agents decide while they fly.
        time_s: Of the slowest agent.
        balance: Slowest over mean flight.
        hover_energy, hover_s: What hovering for every decision costs on top: of all agents, in the unit of E, and of
            the slowest agent.
    """

    nm: float
    kr: float
    cells: float
    energy: float
    time_s: float
    balance: float
    hover_energy: float
    hover_s: float

    def accuracy(self, how: How) -> float:
        """Accuracy of one kind of map."""
        return self.nm if how is How.NM else self.kr


@dataclass(frozen=True)
class Way:
    """How a mission is flown.

    Args:
        exploration: Share of random moves.
        thresholds: T_u and T_v; what was learned when None.
        seed: Of the random moves.
    """

    exploration: float = 0.0
    thresholds: tuple[float, int] | None = None
    seed: int = 0


def flown(learned: Learned, ways: Sequence[Way]) -> list[Outcome]:
    """One mission in each way over the field that nothing was learned on."""
    ground = learned.terrain
    table = score_table({INITIAL: learned.model}, ALONE, ground)
    found = []
    for way in ways:
        utility, visited = way.thresholds or (learned.reward.utility_threshold, learned.reward.visited_threshold)
        reward = learned.reward.model_copy(update={"utility_threshold": utility, "visited_threshold": visited})
        flights = Flights(exploration=way.exploration, seed=way.seed)
        mission = fly(ground.layout, batch_of(table, reward, ground, flights))
        found.append(judged(Field(ground.environment), mission))
    return found


def judged(place: Field, mission: Flown) -> Outcome:
    """What became of the only mission of a batch."""
    agents = mission.steps.shape[1]
    counts = [mission.counts(0, agent) for agent in range(agents)]
    flying, hovering = ([model.flight(each) for each in counts] for model in (ENERGY, HOVERING))
    captured = mission.captured[0]
    accuracy = accuracies(place, captured, (How.NM, How.KR))
    times = [cost.time_s for cost in flying]
    all_j, spent_j, hovered_j = (
        thorough_j(place, agents),
        *(sum(cost.energy_j for cost in costs) for costs in (flying, hovering)),
    )
    return Outcome(
        nm=accuracy[How.NM],
        kr=accuracy[How.KR],
        cells=float(np.count_nonzero(captured)) / len(place.cells),
        energy=spent_j / all_j,
        time_s=max(times),
        balance=max(times) / float(np.mean(times)),
        hover_energy=(hovered_j - spent_j) / all_j,
        hover_s=max(cost.time_s for cost in hovering) - max(times),
    )


def sweep(learned: Learned, exploration: float = 0.0, seed: int = 0) -> list[Outcome]:
    """Missions that capture ever more cells of each group, the same number in all: from 1 to all."""
    most = max(len(cells) for cells in learned.terrain.layout.groups)
    return flown(learned, [Way(exploration, (NEVER[0], last), seed) for last in range(most)])


def untaught(place: Field, agents: int) -> Learned:
    """A swarm that has learned nothing: its scores are all alike."""
    fleet = fleet_of(Course(place.name, agents, goal=1.0))
    normaliser = Normaliser(low=(0.0,), high=(1.0,))
    utility, visited = NEVER
    reward = RewardModel(
        features=QUANTITY, weights=(0.0,), normaliser=normaliser, utility_threshold=utility,
        visited_threshold=visited, loss=0.0, goals_met=False,
    )  # fmt: skip
    return Learned(reward, blank_model(fleet.sa, QUANTITY, normaliser, 0), terrain(fleet, place, QUANTITY))


def at(swept: Sequence[Outcome], figure: str, value: float) -> Outcome:
    """The mission between those of a sweep that has a value of a figure, by straight lines; NaN when none reaches it.

    Below the first mission that one stands for it: no group can be left out.
    """
    table = np.array(swept)
    along = np.maximum.accumulate(table[:, Outcome._fields.index(figure)])
    if value > along[-1]:
        return Outcome(*[float("nan")] * len(Outcome._fields))
    return Outcome(*(float(np.interp(value, along, column)) for column in table.T))


def arms(course: Course) -> tuple[dict[Arm, Outcome], list[Outcome]]:
    """Learn, and fly every arm; and a sweep with the learned moves."""
    learned = learn(course)
    swept = sweep(learned)
    paper, wandering, thorough = flown(learned, [Way(), Way(exploration=1.0, seed=course.seed), Way(thresholds=NEVER)])
    found = {
        Arm.PAPER: paper,
        Arm.RANDOM_MOVES: wandering,
        Arm.FIXED_V: at(swept, "cells", paper.cells),
        Arm.NO_SHAPING: thorough,
    }
    if course.agents == WEIGHED_AT:
        found[Arm.EQUAL_WEIGHTS] = flown(learn(with_equal_weights(course, learned.terrain.features)), [Way()])[0]
    return found, swept


def with_equal_weights(course: Course, features: Sequence[str]) -> Course:
    """The same with weights that are given, equal, and 1 in sum."""
    weights = dict.fromkeys(features, 1.0 / len(features))
    shaping = course.settings.get("rewardShaping", {})
    if not isinstance(shaping, Mapping):
        raise TypeError(f"rewardShaping is {shaping!r}; write its fields")
    return replace(course, settings={**course.settings, "rewardShaping": {**shaping, "weights": weights}})

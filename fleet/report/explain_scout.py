"""Why an agent that plans did what it did in a step: its claim, what it believed of the cells ahead, and its plan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fleet.missions.layout import MOVES
from fleet.missions.records import Record
from fleet.planning.interest import FEW, features, interest
from fleet.planning.scouting import Ending
from fleet.planning.stop import Claim, StopRule
from fleet.planning.tactics import InterestWeights
from fleet.runtime.scout_mind import ScoutMind, ScoutThought
from fleet.spec.learning import BELIEVED


@dataclass(frozen=True)
class Next:
    """A cell that a move leads to.

    Args:
        is_open: Whether it has data and is not known to be captured; only then it is worth anything.
        believed: Doubt, doubt around and novelty.
        scores: What each model says that its capture is worth, by model.
        blended: The same as one.
    """

    cell: int
    is_open: bool
    believed: tuple[float, ...]
    scores: Mapping[str, float]
    blended: float


@dataclass(frozen=True, eq=False)
class ScoutExplanation:
    """One step of a log and why.

    Args:
        record: The step, as the log has it.
        ssv: What was captured, by feature; empty when nothing was.
        heard: How many records of each other agent were known, by name; empty between two looks.
        claim: What the agent claimed of its map; None between two looks.
        ending: Why it lands; None when it flies on.
        rule: When it lands.
        weights: Of each model that has one.
        interests: What each of these models makes of a cell.
        blended: The same as one.
        ahead: The cell that each move leads to, by move; empty where SA was not asked.
    """

    record: Record
    ssv: Mapping[str, float]
    heard: Mapping[str, int]
    claim: Claim | None
    ending: Ending | None
    rule: StopRule
    weights: Mapping[str, float]
    interests: Mapping[str, InterestWeights]
    blended: InterestWeights
    ahead: Mapping[int, Next]


def explained(mind: ScoutMind, record: Record, thought: ScoutThought) -> ScoutExplanation:
    """What a mind thought in a state that it has just lived again."""
    names = mind.agents
    heard = {name: count for name, count in zip(names, record.heard, strict=False) if name != names[mind.index]}
    return ScoutExplanation(
        record=record,
        ssv=dict(zip(mind.reward.features, record.ssv, strict=True)) if record.captured else {},
        heard=heard,
        claim=thought.claim,
        ending=thought.ending,
        rule=mind.rule,
        weights=mind.weights,
        interests={key: model.interest for key, model in mind.models.items()},
        blended=mind.scouting.tactics.weights,
        ahead=_ahead(mind, record) if record.legal else {},
    )


def _ahead(mind: ScoutMind, record: Record) -> dict[int, Next]:
    """The belief is still that of the look: it changes at the next one."""
    belief, grid = mind.scouting.belief, mind.scouting.grid
    believed = features(belief).reshape(len(BELIEVED), -1) if belief.captured >= FEW else None
    of_model = {key: interest(belief, model.interest).reshape(-1) for key, model in mind.models.items()}
    blended, free = interest(belief, mind.scouting.tactics.weights).reshape(-1), belief.free.reshape(-1)
    found = {}
    for move in range(len(MOVES)):
        cell = grid.neighbour(record.cell, MOVES[move]) if record.legal >> move & 1 else None
        if cell is not None:
            found[move] = Next(
                cell=cell,
                is_open=bool(free[cell]),
                believed=() if believed is None else tuple(np.nan_to_num(believed[:, cell]).tolist()),
                scores={key: float(scores[cell]) for key, scores in of_model.items()},
                blended=float(blended[cell]),
            )
    return found

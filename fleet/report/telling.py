"""What an explanation says to people: short lines, and a table of scores."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from fleet.missions.layout import MOVES
from fleet.report import measures
from fleet.report.explain import Explanation, GroupState, Reason

STEPS_HEADER = ("step", "row", "col", "captured", "group", "legal", "move", "why")
_SHORT = {
    Reason.HIGHEST_SCORE: "highest score",
    Reason.EXPLORATION: "exploration",
    Reason.TRAVEL_IN_GROUP: "travels in its group",
    Reason.TRAVEL_TO_GROUP: "travels to its next group",
    Reason.ALL_GROUPS_EXPLORED: "all groups explored",
    Reason.EVAL_FINISHED: "Eval() said finished",
}


def step_row(step: Explanation) -> tuple[str, ...]:
    """A step in short, under `STEPS_HEADER`."""
    record = step.record
    return (
        str(record.step),
        str(record.row),
        str(record.column),
        "yes" if record.captured else "no",
        str(step.groups[-1].number),
        moves(step.legal) if step.legal else "-",
        record.action,
        because(step) if len(step.legal) == 1 else _SHORT[step.reason],
    )


def lines(step: Explanation) -> Iterator[tuple[str, str]]:
    """What is said of a step above and below its scores: what it is about, and a sentence."""
    record = step.record
    yield "where", f"row {record.row}, column {record.column} (cell {record.cell}), {_group_of_cell(step)}"
    arrived, energy = measures.duration(record.time_s), measures.text("uav_energy_j", record.uav_energy_j)
    yield "when", f"{arrived} after the start of the mission; {energy} spent"
    captured = ", ".join(f"{feature} {value:.4g}" for feature, value in step.ssv.items())
    yield "captured", captured or "nothing: no data here, or captured before, or on the way"
    yield from (("HA", sentence) for sentence in _history(step))
    if step.finished is not None:
        yield "Eval()", "was asked, and said finished" if step.finished else "was asked, and said not finished"
    yield "SA", f"was asked; legal moves: {moves(step.legal)}" if step.legal else f"was not asked: {_unasked(step)}"
    yield "choice", f"{record.action}: {because(step)}"


def scores(step: Explanation) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """Header and rows: each model with its weight and its score of each legal move, and the blended scores.

    Models of the largest weight come first; nothing when SA was not asked.
    """
    header = ("model", "weight", *(str(MOVES[move]) for move in step.legal))
    keys = sorted(step.scores, key=lambda key: (-step.weights[key], key))
    rows = [
        (key, f"{step.weights[key]:.6f}", *(f"{step.scores[key][move]:.6f}" for move in step.legal)) for key in keys
    ]
    blended = ("blended", "", *(f"{step.blended[move]:.9f}" for move in step.legal))
    return header, (*rows, blended) if rows else ()


def document(step: Explanation) -> dict[str, object]:
    """A step for machines; moves and features by name, groups by their number in the agent's part."""
    record = step.record
    return {
        "step": record.step,
        "cell": record.cell,
        "row": record.row,
        "column": record.column,
        "time_s": record.time_s,
        "uav_energy_j": record.uav_energy_j,
        "captured": dict(step.ssv) if record.captured else None,
        "utility_threshold": step.thresholds[0],
        "visited_threshold": step.thresholds[1],
        "groups": [_group_document(group) for group in step.groups],
        "ha_asked": step.asked_ha,
        "eval_finished": step.finished,
        "legal": [str(MOVES[move]) for move in step.legal],
        "models": [
            {"model": key, "weight": step.weights[key], "scores": _by_name(step.scores[key])} for key in step.scores
        ],
        "blended": _by_name(step.blended),
        "move": record.action,
        "reason": str(step.reason),
        "because": because(step),
        "target": list(step.target) if step.target else None,
    }


def moves(legal: tuple[int, ...]) -> str:
    """Moves by name."""
    return ", ".join(MOVES[move] for move in legal)


def because(step: Explanation) -> str:
    """Why the move was made, in a few words."""
    match step.reason:
        case Reason.HIGHEST_SCORE:
            return _highest(step)
        case Reason.EXPLORATION:
            return "drawn at random among the legal moves (flightExploration)"
        case Reason.ALL_GROUPS_EXPLORED:
            return "all state groups of the agent are explored"
        case Reason.EVAL_FINISHED:
            return "Eval() said finished"
        case Reason.TRAVEL_IN_GROUP | Reason.TRAVEL_TO_GROUP:
            assert step.target is not None  # who travels has a target
            row, column = step.target
            to = "to the nearest cell left in" if step.asked_ha else "still on the way to a cell of"
            return f"{to} its state group {step.groups[-1].number}: row {row}, column {column}"


def _highest(step: Explanation) -> str:
    if len(step.legal) == 1:
        return "the only legal move"
    best = max(step.blended.values())
    equals = sum(score == best for score in step.blended.values())
    return "the highest blended score" + (f", the first of {equals} equal ones" if equals > 1 else "")


def _group_of_cell(step: Explanation) -> str:
    explored = step.groups[0]
    number = step.group_of_cell - explored.history.group + explored.number
    if step.group_of_cell < 0:
        place = "without data"
    elif 1 <= number <= step.groups_of_agent:
        place = f"in its state group {number} of {step.groups_of_agent}"
    else:
        place = "in a state group of another agent"
    return place if number == explored.number else f"{place}; explores group {explored.number}"


def _history(step: Explanation) -> Iterator[str]:
    if not step.asked_ha:
        yield f"was not asked: the agent is on its way to group {step.groups[-1].number}"
        return
    for group in step.groups:
        yield f"group {group.number}: {_numbers(group, step.thresholds)}: {_verdict(group)}"


def _numbers(group: GroupState, thresholds: tuple[float, int]) -> str:
    utility, visited = thresholds
    history = group.history
    u = f"U {history.utility:.4g} {'>' if group.useful_enough else '<='} T_u {utility:.4g}"
    v = f"V {history.visited} {'>' if group.seen_enough else '<='} T_v {visited}"
    return f"{u}, {v}, {history.visited} of {history.cells} cells captured"


def _verdict(group: GroupState) -> str:
    if not group.is_left:
        return "explored further"
    return "left, as every cell is captured" if group.history.is_whole else "left"


def _unasked(step: Explanation) -> str:
    match step.reason:
        case Reason.ALL_GROUPS_EXPLORED | Reason.EVAL_FINISHED:
            return "the flight ends"
        case _ if not step.asked_ha:
            return "the agent is on its way to a cell"
        case Reason.TRAVEL_TO_GROUP:
            return "the agent is not in the group that it explores now"
        case _:
            return "no neighbour in the group is left to capture"


def _group_document(group: GroupState) -> dict[str, object]:
    history = group.history
    return {
        "number": group.number,
        "utility": history.utility,
        "visited": history.visited,
        "cells": history.cells,
        "useful_enough": group.useful_enough,
        "seen_enough": group.seen_enough,
        "left": group.is_left,
    }


def _by_name(scores: Mapping[int, float]) -> dict[str, float]:
    return {str(MOVES[move]): score for move, score in scores.items()}

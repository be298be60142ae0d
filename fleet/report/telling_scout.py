"""What the explanation of an agent that plans says to people: short lines, and a table of scores."""

from __future__ import annotations

from collections.abc import Iterator

from fleet.missions.layout import MOVES
from fleet.missions.records import Record
from fleet.planning.scouting import Ending
from fleet.planning.stop import Claim
from fleet.report import measures
from fleet.report.explain_scout import ScoutExplanation
from fleet.spec.learning import BELIEVED

STEPS_HEADER = ("step", "row", "col", "captured", "known", "claim", "needed", "move", "why")
_ENDINGS = {
    Ending.GOAL_CLAIMED: "the map is good enough",
    Ending.ANOTHER_LANDED: "another agent has landed, as the map is good enough",
    Ending.ALL_CAPTURED: "every cell with data is captured",
}


def needed(step: ScoutExplanation) -> float | None:
    """The accuracy that the agent had to claim to land; None where it made no claim, or could not land by one."""
    if step.claim is None or step.claim.predictions == 0:
        return None
    return step.rule.needed(step.claim.predictions)


def step_row(step: ScoutExplanation) -> tuple[str, ...]:
    """A step in short, under `STEPS_HEADER`."""
    record, claim, least = step.record, step.claim, needed(step)
    return (
        str(record.step),
        str(record.row),
        str(record.column),
        "yes" if record.captured else "no",
        str(claim.captured) if claim else "-",
        f"{claim.accuracy:.1%}" if claim else "-",
        f"{least:.1%}" if least is not None else "-",
        record.action,
        because(step),
    )


def because(step: ScoutExplanation) -> str:
    """Why the move was made, in a few words."""
    if step.ending is not None:
        return _ENDINGS[step.ending]
    if step.claim is None:
        return "goes on with its plan"
    return "the first move of the path that is worth most"


def lines(step: ScoutExplanation) -> Iterator[tuple[str, str]]:
    """What is said of a step above and below its scores: what it is about, and a sentence."""
    record, claim = step.record, step.claim
    yield "where", f"row {record.row}, column {record.column} (cell {record.cell})"
    arrived, energy = measures.duration(record.time_s), measures.text("uav_energy_j", record.uav_energy_j)
    yield "when", f"{arrived} after the start of the mission; {energy} spent"
    captured = ", ".join(f"{feature} {value:.4g}" for feature, value in step.ssv.items())
    yield "captured", captured or "nothing: no data here, or captured before, as far as the agent had heard"
    if step.heard:
        yield "heard", ", ".join(f"{count} states of {name}" for name, count in step.heard.items())
    if claim is None:
        yield "HA", "was not asked: the agent looks again when it has flown what it planned to"
    else:
        yield "HA", _history(step, claim)
    if step.ahead:
        yield "SA", f"was asked: the best path is {_path(record)}"
    else:
        yield "SA", f"was not asked: {'the flight ends' if step.ending else f'the plan goes on: {_path(record)}'}"
    yield "choice", f"{record.action}: {because(step)}"


def scores(step: ScoutExplanation) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """Header and rows: what is believed of the cell that each move leads to, and what each model makes of it."""
    if not step.ahead:
        return (), ()
    header = ("", "weight", *(str(MOVES[move]) for move in step.ahead))
    cells = step.ahead.values()
    rows: list[tuple[str, ...]] = [("cell", "", *(f"{one.cell}{'' if one.is_open else ' (known)'}" for one in cells))]
    if all(one.believed for one in cells):
        for index, name in enumerate(BELIEVED):
            weight = f"{getattr(step.blended, name):.4f}"
            rows.append((name, weight, *(f"{one.believed[index]:.4f}" for one in cells)))
    rows += [
        (f"model {key}", f"{step.weights[key]:.6f}", *(f"{one.scores[key]:.6f}" for one in cells))
        for key in sorted(step.weights, key=lambda key: (-step.weights[key], key))
    ]
    rows.append(("blended", "", *(f"{one.blended:.6f}" for one in cells)))
    return header, tuple(rows)


def document(step: ScoutExplanation) -> dict[str, object]:
    """A step for machines; moves and features by name."""
    record, claim = step.record, step.claim
    return {
        "step": record.step,
        "cell": record.cell,
        "row": record.row,
        "column": record.column,
        "time_s": record.time_s,
        "uav_energy_j": record.uav_energy_j,
        "captured": dict(step.ssv) if record.captured else None,
        "heard": dict(step.heard),
        "claim": None
        if claim is None
        else {"accuracy": claim.accuracy, "captured": claim.captured, "predictions": claim.predictions},
        "needed": needed(step),
        "goal": step.rule.goal,
        "caution": step.rule.caution,
        "ending": step.ending and str(step.ending),
        "models": [
            {
                "model": key,
                "weight": step.weights[key],
                "interest": step.interests[key].model_dump(),
                "scores": {str(MOVES[move]): one.scores[key] for move, one in step.ahead.items()},
            }
            for key in step.weights
        ],
        "interest": step.blended.model_dump(),
        "ahead": {
            str(MOVES[move]): {
                "cell": one.cell,
                "open": one.is_open,
                "believed": dict(zip(BELIEVED, one.believed, strict=False)),
                "blended": one.blended,
            }
            for move, one in step.ahead.items()
        },
        "plan": [str(MOVES[move]) for move in record.plan],
        "move": record.action,
        "because": because(step),
    }


def _history(step: ScoutExplanation, claim: Claim) -> str:
    least = needed(step)
    known = f"{claim.captured:,} cells known"
    if step.ending is Ending.ALL_CAPTURED:
        return f"{known}: all of them"
    if least is None:
        return f"{known}; too few to claim anything of the others"
    stated = f"{known}; {claim.accuracy:.1%} of the map expected right, by {claim.predictions:,} predictions"
    verdict = f"{least:.1%} needed for a goal of {step.rule.goal:.0%} with a caution of {step.rule.caution:.2f}"
    return f"{stated}; {verdict}: {_ENDINGS[step.ending] if step.ending else 'flies on'}"


def _path(record: Record) -> str:
    """Moves to come, in short: 3 North, 2 East."""
    runs: list[tuple[int, int]] = []
    for move in (record.move, *record.plan):
        if runs and runs[-1][0] == move:
            runs[-1] = (move, runs[-1][1] + 1)
        else:
            runs.append((move, 1))
    return ", ".join(f"{count} {MOVES[move]}" for move, count in runs)

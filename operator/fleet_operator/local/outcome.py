"""What a run came to, for the terminal and for machines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import typer

from fleet.cli import console
from fleet.errors import ExitCode
from fleet.missions.documents import GoalResult, MissionEvaluation
from fleet_operator.local.service import ModelStanding, Summary

_MODELS_SHOWN = 16


def show(summary: Summary) -> None:
    """The tables of missions and models, the report's place, and loudly every goal that the last mission missed."""
    if summary.missions:
        console.table(
            ("mission", "coverage", "accuracy", "time", "uav energy", "edge energy", "goals"),
            [_mission_row(mission) for mission in summary.missions],
        )
    if summary.models:
        console.say()
        _show_models(summary.models)
    console.say()
    if len(summary.missions) < summary.asked:
        console.say(f"suspended after {len(summary.missions)} of {summary.asked} missions: spec.suspend is true")
    console.say(f"report: {summary.report or 'could not be written'}")
    for result in summary.missed:
        typer.secho(f"GOAL MISSED: {miss(result)}", fg=typer.colors.RED, bold=True, err=True)


def _show_models(models: Sequence[ModelStanding]) -> None:
    """All models, or the most useful of many: a powerset of 8 agents has 255."""
    shown = models
    if len(models) > _MODELS_SHOWN:
        shown = sorted(models, key=lambda each: -(each.usefulness or 0.0))[:_MODELS_SHOWN]
    rows = [(each.key, _number(each.usefulness), _level(each.level)) for each in shown]
    console.table(("model", "usefulness", "level"), rows)
    if len(shown) < len(models):
        console.say(f"and {len(models) - len(shown)} less useful ones, which are in the report")


def exit_code(summary: Summary) -> ExitCode:
    """0 when the last mission met all goals and there is a report of it."""
    if summary.missed:
        return ExitCode.GOALS_MISSED
    return ExitCode.OK if summary.report is not None else ExitCode.TRANSIENT


def to_json(summary: Summary) -> dict[str, Any]:
    """The same as one document."""
    return {
        "goalsMet": bool(summary.missions) and not summary.missed,
        "missions": [
            {**mission.model_dump(by_alias=True, mode="json"), "goalsMet": mission.goals_met}
            for mission in summary.missions
        ],
        "models": [{"key": each.key, "usefulness": each.usefulness, "level": each.level} for each in summary.models],
        "report": None if summary.report is None else str(summary.report),
        "run": summary.document.model_dump(by_alias=True, mode="json"),
    }


def miss(result: GoalResult) -> str:
    """Which goal was missed, and by how much."""
    goal = result.goal
    if result.value is None:
        return f"Eval() gave no metric {goal.metric}"
    if goal.at_least is not None and result.value < goal.at_least:
        return f"{goal.metric} is {result.value:.4g}, {goal.at_least - result.value:.4g} below {goal.at_least:g}"
    limit = goal.at_most if goal.at_most is not None else result.value
    return f"{goal.metric} is {result.value:.4g}, {result.value - limit:.4g} above {limit:g}"


def _mission_row(mission: MissionEvaluation) -> tuple[str, ...]:
    met = sum(result.met for result in mission.goals)
    return (
        str(mission.number),
        _percent(mission.metrics.get("coverage")),
        _percent(mission.metrics.get("accuracy")),
        f"{mission.system.time_s:.0f} s",
        f"{mission.system.uav_energy_j / 1000:.1f} kJ",
        f"{mission.system.edge_energy_j / 1000:.1f} kJ",
        f"{met}/{len(mission.goals)}",
    )


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f} %"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _level(level: int | None) -> str:
    return "-" if level is None else str(level)

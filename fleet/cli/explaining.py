"""`fleet explain`."""

# ruff: noqa: PLC0415 - imports wait until a command runs, so that --help is quick

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from fleet.cli import console, runs
from fleet.errors import Problem, SpecError

if TYPE_CHECKING:
    from fleet.report.explain import FlownLog
    from fleet.runtime.settings import Settings
    from fleet.storage.layout import FleetPaths
    from fleet.storage.port import Storage


def explain(  # noqa: PLR0913, PLR0917 - the options of a command
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a run: what --out of fleet run named.")],
    agent: Annotated[str, typer.Option(help="Name of an agent, or its number: 1 for the first.")],
    step: Annotated[
        int | None, typer.Option(help="Step of its log, 0 in the take-off cell; all in short when left out.")
    ] = None,
    mission: Annotated[int | None, typer.Option(help="Number of the mission; the last when left out.")] = None,
    storage: Annotated[
        str | None, typer.Option(help="Folder or address of the run's storage, when it is not in DIR.")
    ] = None,
    fleet: Annotated[str | None, typer.Option(help="NAMESPACE/NAME, when the storage has several fleets.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="For machines: the same, and all of it.")] = False,
) -> None:
    """Say why an agent made a move in a flown mission: SSV, HA, scores, weights, choice.

    Example: [bold]fleet explain out/my-swarm --agent 2 --step 40[/bold]
    """
    from fleet.report.explain import open_log

    place = runs.storage_of(folder, storage)
    settings = _settings(place, runs.fleet_in(place, fleet), agent, mission)
    log = open_log(settings)
    if step is not None and not 0 <= step < len(log.records):
        message = f"the log of {settings.agent} in mission {settings.mission} has no step {step}"
        there = [f"it has steps 0 to {len(log.records) - 1}", *_remarks(log)]
        _refuse("--step", message, "; ".join(there))
    told = _scout_told(log, step) if log.plans else _told(log, step)
    if as_json:
        console.say_json(_document(settings, log, told))
    elif step is None:
        console.say(_title(settings, log))
        console.table(told.header, told.rows)
    else:
        _say_one(settings, log, told)
    for remark in _remarks(log):
        console.note(f"warning: {remark}")


def _remarks(log: FlownLog) -> list[str]:
    """What is amiss with a log; nothing when it goes from take-off to landing."""
    if log.lost:
        return [f"the log is damaged: step {len(log.records)} is missing, so {log.lost} after it cannot be explained"]
    if not log.has_landed:
        return ["the log ends before the landing: the agent is in the air, has failed, or the end of the log is lost"]
    return []


def _settings(place: Storage, paths: FleetPaths, agent: str, mission: int | None) -> Settings:
    """Of the agent and the mission that are meant."""
    from fleet.report.explain import agents_of, flights_of
    from fleet.runtime.settings import Settings

    fleet = Settings(place.uri, paths.namespace, paths.fleet)
    names = agents_of(fleet)
    number = int(agent) if agent.isdecimal() else 0
    if agent not in names and not 1 <= number <= len(names):
        _refuse("--agent", f"there is no agent {agent}", f"choose one of {', '.join(names)}, or 1 to {len(names)}")
    settings = replace(fleet, agent=agent if agent in names else names[number - 1])
    flown = flights_of(settings)
    if not flown:
        _refuse("DIR", f"{settings.agent} has no log of any mission", "fly one with fleet run")
    if mission is not None and mission not in flown:
        flights = ", ".join(str(one) for one in flown)
        _refuse("--mission", f"{settings.agent} has no log of a mission {mission}", f"it has those of {flights}")
    return settings.at_mission(mission or flown[-1])


def _refuse(path: str, message: str, hint: str) -> NoReturn:
    raise SpecError([Problem(path, message, hint)], "the command line")


@dataclass(frozen=True)
class _Told:
    """What is said of steps.

    Args:
        header, rows: Each in short.
        lines, scores: The first one at length: what each line is about and what it says, and a table.
        documents: Each for machines.
    """

    header: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    lines: Sequence[tuple[str, str]]
    scores: tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]
    documents: Sequence[dict[str, object]]


def _told(log: FlownLog, step: int | None) -> _Told:
    from fleet.report import telling

    steps = log.explain(step)
    return _Told(
        header=telling.STEPS_HEADER,
        rows=[telling.step_row(one) for one in steps],
        lines=list(telling.lines(steps[0])),
        scores=telling.scores(steps[0]),
        documents=[telling.document(one) for one in steps],
    )


def _scout_told(log: FlownLog, step: int | None) -> _Told:
    from fleet.report import telling_scout

    steps = log.explain_scout(step)
    return _Told(
        header=telling_scout.STEPS_HEADER,
        rows=[telling_scout.step_row(one) for one in steps],
        lines=list(telling_scout.lines(steps[0])),
        scores=telling_scout.scores(steps[0]),
        documents=[telling_scout.document(one) for one in steps],
    )


def _say_one(settings: Settings, log: FlownLog, told: _Told) -> None:
    number = told.documents[0]["step"]
    console.say(f"{_title(settings, log)}, step {number} of {len(log.records) - 1}")
    for subject, sentence in told.lines:
        console.say(f"{subject:<9} {sentence}")
    header, rows = told.scores
    if rows:
        console.say()
        console.table(header, rows)


def _title(settings: Settings, log: FlownLog) -> str:
    return f"Mission {settings.mission} over {log.context}, {settings.agent}"


def _document(settings: Settings, log: FlownLog, told: _Told) -> dict[str, object]:
    return {
        "mission": settings.mission,
        "context": log.context,
        "agent": settings.agent,
        "recorded": len(log.records),
        "lost": log.lost,
        "steps": list(told.documents),
    }

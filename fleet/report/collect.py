"""Everything that a run has left in storage, typed; whatever is missing or unreadable is left out and noted."""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, TypeAdapter, ValidationError

from fleet.contexts.base import Context, Environment
from fleet.contexts.cube import AutonomyCube
from fleet.contexts.load import load_context
from fleet.errors import ContextError, ObjectNotFound
from fleet.functions import wire
from fleet.learning.reward import RewardModel
from fleet.missions.documents import (
    INITIAL,
    Landing,
    MissionEvaluation,
    MissionOrder,
    RetrainingReport,
    TrainerReport,
    WeightsDocument,
)
from fleet.missions.records import Record, read_log
from fleet.spec.resources import FleetSpec
from fleet.storage.layout import FleetPaths
from fleet.storage.port import Storage

Read = TypeVar("Read")
TRIALS = "trials.json"
"""Checkpoint of reward shaping in its folder."""


class Trial(BaseModel):
    """A parameter set that reward shaping simulated, as its checkpoint has it.

    Args:
        goals: Values of the goals' metrics and of the one to minimise, for each shaping context.
    """

    loss: float
    goals_met: bool
    goals: tuple[dict[str, float | None], ...] = ()

    def mean(self, metric: str) -> float:
        """Mean of a metric over the contexts; NaN when one of them has none."""
        values = [np.nan if (found := one.get(metric)) is None else found for one in self.goals]
        return float(np.mean(values)) if values else float("nan")


@dataclass(frozen=True)
class AgentRun:
    """One agent in one mission: its visited states in order, and how it ended (None while it flies)."""

    agent: str
    records: tuple[Record, ...]
    landing: Landing | None

    @property
    def choices(self) -> int:
        """States that SA chose the move of; where one move was legal there was nothing to choose."""
        return sum(record.legal.bit_count() > 1 for record in self.records)

    @property
    def moves(self) -> int:
        """Moves, without the landing."""
        return sum(record.move >= 0 for record in self.records)


@dataclass(frozen=True, eq=False)
class MissionRun:
    """What is there of one flown mission.

    Args:
        number: 1 for the first.
        context: Name of the context that was flown over; "" when unknown.
        environment: Grid and truth of that context; None when it cannot be read.
        rendered: Whether pictures of the context are drawn from its features and were not taken.
        agents: In the order of the FleetSpec.
        evaluation: None until the mission is over.
        artefacts: Grids of Eval(), float64 [rows, columns], by name.
    """

    number: int
    context: str = ""
    environment: Environment | None = None
    rendered: bool = False
    agents: tuple[AgentRun, ...] = ()
    evaluation: MissionEvaluation | None = None
    artefacts: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    @property
    def failures(self) -> dict[str, str]:
        """Why agents failed, by name."""
        landed = {run.agent: run.landing.message for run in self.agents if run.landing and run.landing.failed}
        return {**landed, **(self.evaluation.failures if self.evaluation else {})}

    @cached_property
    def captured(self) -> frozenset[int]:
        """Cells that some agent captured."""
        return frozenset(record.cell for run in self.agents for record in run.records if record.captured)

    @cached_property
    def visited(self) -> frozenset[int]:
        """Cells in which some agent was, captured or not."""
        return frozenset(record.cell for run in self.agents for record in run.records)


@dataclass(frozen=True, eq=False)
class RunData:
    """A finished, broken-off or empty run.

    Args:
        spec: The FleetSpec that it was started with; None when that cannot be read.
        trials: Parameter sets that reward shaping has simulated so far, in order.
        missions: Flown missions, by number.
        weights: Weights over the models and their usefulness, by the mission that flies with them.
        retraining: What the aggregators did, by the mission after which they ran.
        trainer: What the trainer spent: on the training under 0, on the weighing under the mission before it.
        notes: What could not be read, and why: sentences for the reader.
    """

    paths: FleetPaths
    spec: FleetSpec | None = None
    reward: RewardModel | None = None
    trials: tuple[Trial, ...] = ()
    missions: tuple[MissionRun, ...] = ()
    weights: Mapping[int, WeightsDocument] = field(default_factory=dict)
    retraining: Mapping[int, tuple[RetrainingReport, ...]] = field(default_factory=dict)
    trainer: Mapping[int, TrainerReport] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def models(self) -> tuple[str, ...]:
        """Keys of all models: the first one, then by size of the subset and name."""
        keys = {key for document in self.weights.values() for key in document.usefulness}
        keys |= {report.subset for reports in self.retraining.values() for report in reports}
        return tuple(sorted(keys, key=lambda key: (key != INITIAL, key.count("-"), _natural(key))))


def collect(storage: Storage, paths: FleetPaths) -> RunData:
    """Read a run from storage; never fails for something that is missing or broken.

    Raises:
        StorageError: the storage itself does not answer.
    """
    reader = _Reader(storage)
    spec = reader.document(paths.fleet_spec, FleetSpec.model_validate_json)
    numbers = sorted(mission_numbers(storage, paths))
    order = [agent.name for agent in spec.spec.agents.resolved] if spec else []
    missions = [_mission(reader, paths, number, order) for number in numbers]
    weights = [reader.document(paths.weights(number), WeightsDocument.model_validate_json) for number in numbers]
    trainer = [
        reader.document(paths.trainer_report(number), TrainerReport.model_validate_json) for number in (0, *numbers)
    ]
    return RunData(
        paths=paths,
        spec=spec,
        reward=reader.document(paths.reward, RewardModel.model_validate_json),
        trials=reader.document(f"{paths.shaping}/{TRIALS}", _trials) or (),
        missions=tuple(mission for mission in missions if mission is not None),
        weights={document.number: document for document in weights if document is not None},
        retraining={number: _retraining(reader, paths, number) for number in numbers},
        trainer={report.number: report for report in trainer if report is not None},
        notes=tuple(reader.notes),
    )


def mission_numbers(storage: Storage, paths: FleetPaths) -> set[int]:
    """Numbers of all missions that have any object."""
    folder = f"{paths.root}/missions/"
    found = (re.match(r"(\d+)/", entry.path.removeprefix(folder)) for entry in storage.list(folder.rstrip("/")))
    return {int(match[1]) for match in found if match}


def _mission(reader: _Reader, paths: FleetPaths, number: int, order: list[str]) -> MissionRun | None:
    """A mission; None when it was prepared but nobody has flown."""
    plan = reader.document(paths.plan(number), MissionOrder.model_validate_json)
    evaluation = reader.document(paths.evaluation(number), MissionEvaluation.model_validate_json)
    runs = [_agent(reader, paths, number, agent) for agent in _agents(reader.storage, paths, number, order)]
    agents = tuple(run for run in runs if run.records or run.landing)
    if not agents and evaluation is None:
        return None
    name = plan.context if plan else evaluation.context if evaluation else ""
    context = reader.context(paths, name) if name else None
    return MissionRun(
        number=number,
        context=name,
        environment=_place(reader, paths, number, context),
        rendered=isinstance(context, AutonomyCube) and context.renders,
        agents=agents,
        evaluation=evaluation,
        artefacts=reader.document(paths.artefacts(number), _grids) or {},
    )


def _place(reader: _Reader, paths: FleetPaths, number: int, context: Context | None) -> Environment | None:
    """The context's environment, with what the mission expected of it."""
    if context is None:
        return None
    flown = reader.document(paths.environment(number), lambda data: wire.decode_environment(wire.load(data)))
    return replace(context.environment, expected=flown.expected) if flown else context.environment


def _agents(storage: Storage, paths: FleetPaths, number: int, order: list[str]) -> list[str]:
    folder = f"{paths.mission(number)}/agents"
    present = {entry.path.removeprefix(f"{folder}/").split("/")[0] for entry in storage.list(folder)}
    return [name for name in order if name in present] + sorted(present - set(order), key=_natural)


def _agent(reader: _Reader, paths: FleetPaths, number: int, agent: str) -> AgentRun:
    return AgentRun(
        agent=agent,
        records=reader.document(paths.log(number, agent), read_log) or (),
        landing=reader.document(paths.landing(number, agent), Landing.model_validate_json),
    )


def _retraining(reader: _Reader, paths: FleetPaths, number: int) -> tuple[RetrainingReport, ...]:
    entries = reader.storage.list(f"{paths.mission(number)}/retraining")
    reports = (reader.document(entry.path, RetrainingReport.model_validate_json) for entry in entries)
    return tuple(report for report in reports if report is not None)


def _grids(data: bytes) -> dict[str, NDArray[np.float64]]:
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        return {name: np.asarray(archive[name], dtype=np.float64) for name in archive.files}


def _trials(data: bytes) -> tuple[Trial, ...]:
    document = json.loads(data)
    return TypeAdapter(tuple[Trial, ...]).validate_python(document["state"]["trials"])


def _natural(text: str) -> list[tuple[int, str]]:
    """A key that puts agent-10 after agent-9."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", text)]


class _Reader:
    """Reads documents, and keeps a note of each that is there but cannot be understood."""

    def __init__(self, storage: Storage) -> None:
        self.storage = storage
        self.notes: list[str] = []
        self._contexts: dict[str, Context | None] = {}

    def document(self, path: str, parse: Callable[[bytes], Read]) -> Read | None:
        try:
            return parse(self.storage.read(path))
        except ObjectNotFound:
            return None
        except (ValidationError, ValueError, KeyError, TypeError, zipfile.BadZipFile, EOFError) as error:
            self.notes.append(f"{path} cannot be read: {_first_line(error)}")
            return None

    def context(self, paths: FleetPaths, name: str) -> Context | None:
        if name not in self._contexts:
            self._contexts[name] = self._load(paths, name)
        return self._contexts[name]

    def _load(self, paths: FleetPaths, name: str) -> Context | None:
        try:
            return load_context(self.storage, paths.context(name))
        except (ObjectNotFound, ContextError) as error:
            self.notes.append(f"the context {name} cannot be read: {_first_line(error)}")
            return None


def _first_line(error: BaseException) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)

"""A run as `fleet run` leaves it in storage, flown by the plain form of a mission over a small made-up field."""

from __future__ import annotations

import io
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from fleet.cli.scaffold.field import made_up_field
from fleet.contexts.base import Environment
from fleet.contexts.files import write_cube
from fleet.contexts.load import load_context
from fleet.energy.accounting import EnergyModel
from fleet.energy.profiles import load_aircraft, load_edge
from fleet.functions.classes import class_mean, classes
from fleet.functions.contract import AgentMetrics, FeatureSpace, Metrics
from fleet.functions.evaluation import evaluation_metrics, yield_map
from fleet.functions.extrapolation import Extrapolation, extrapolate
from fleet.learning.reward import Normaliser, RewardModel
from fleet.missions.accounting import agent_metrics
from fleet.missions.documents import (
    Landing,
    MissionEvaluation,
    MissionOrder,
    ModelReference,
    RetrainingReport,
    WeightsDocument,
    judge,
)
from fleet.missions.flight import LAND, Flight
from fleet.missions.history import ThresholdHA
from fleet.missions.layout import MOVES, Layout, plan_layout
from fleet.missions.odometer import Odometer
from fleet.missions.records import Record
from fleet.randomness import uniform
from fleet.report.collect import collect
from fleet.report.write import write_report
from fleet.spec.base import Model
from fleet.spec.resources import FleetSpec
from fleet.storage.layout import FleetPaths
from fleet.storage.local import LocalStorage

PATHS = FleetPaths("default", "small-field")
SPEC = FleetSpec.model_validate(
    {
        "metadata": {"name": "small-field"},
        "spec": {
            "agents": {"count": 2},
            "stateSpace": {"context": "field"},
            "map": {"function": "small:map_observation"},
            "eval": {"function": "small:evaluate"},
            "contexts": [{"name": "field", "uri": "contexts/field", "use": ["Mission"]}],
            "goals": [{"metric": "accuracy", "atLeast": 0.6}, {"metric": "uav_energy_j", "atMost": 30000}],
            "missions": {"count": 3, "seed": 7},
        },
    }
)
MODELS = ("initial", "1", "2", "1-2")
ENERGY = EnergyModel(load_aircraft("spark-survey"), load_edge("laptop-i5"))


class RunOfTwoMissions:
    """Writes the documents of a run, in the order in which the roles would."""

    def __init__(self, storage: LocalStorage) -> None:
        self.storage = storage
        write_cube(made_up_field("field", 2), storage, PATHS.context("field"))
        self.environment: Environment = load_context(storage, PATHS.context("field")).environment
        self.layout: Layout = plan_layout(self.environment.grid, SPEC.spec.state_space, SPEC.spec.agents.resolved)
        assert self.environment.truth is not None
        self.exg = self.environment.truth.reshape(-1)

    def write(self) -> RunOfTwoMissions:
        self.put(PATHS.fleet_spec, SPEC)
        self.put(
            PATHS.reward,
            RewardModel(
                features=("exg",),
                weights=(0.75,),
                normaliser=Normaliser(low=(0.0,), high=(100.0,)),
                utility_threshold=1.5,
                visited_threshold=3,
                loss=1.25,
                goals_met=False,
                evaluations=48,
            ),
        )
        goals = [{"accuracy": 0.5, "uav_energy_j": 30000.0}]
        trials = [{"period": 0, "point": [0.75, 1.5, 3], "loss": 1.25, "goals_met": False, "goals": goals}] * 48
        checkpoint = {"fingerprint": "of a problem", "state": {"trials": trials}}
        self.storage.write(f"{PATHS.shaping}/trials.json", json.dumps(checkpoint).encode())
        for number in (1, 2):
            self.mission(number)
        return self

    def mission(self, number: int) -> None:
        share = 1 / len(MODELS)
        weights = {agent.name: dict.fromkeys(MODELS, share) for agent in SPEC.spec.agents.resolved}
        useful = dict.fromkeys(MODELS) if number == 1 else dict(zip(MODELS, (0.1, 0.2, 0.3, 0.4), strict=True))
        models = tuple(ModelReference(key=key, path=f"models/{key}.npz") for key in MODELS)
        self.put(
            PATHS.plan(number), MissionOrder(number=number, context="field", seed=7, models=models, weights=weights)
        )
        self.put(PATHS.weights(number), WeightsDocument(number=number, weights=weights, usefulness=useful))
        metrics = Metrics(tuple(self.agent(number, index) for index in range(2)))
        self.evaluate(number, metrics)
        for level, subset in enumerate(MODELS[1:], start=1):
            report = RetrainingReport(
                number=number, subset=subset, transitions=40, cpu_s=0.5, wall_s=0.6, energy_j=12.5, level=level
            )
            self.put(PATHS.retraining(number, subset), report)

    def agent(self, number: int, index: int) -> AgentMetrics:
        name = SPEC.spec.agents.resolved[index].name
        flight = Flight(self.layout, index, ThresholdHA(50.0, 2 + number), seed=7, mission=number)
        odometer = Odometer(ENERGY)
        while not flight.landed:
            record = self.visit(flight, odometer, number)
            self.storage.append(PATHS.log(number, name), record.to_line())
        first, last = self.layout.parts[index]
        metrics = agent_metrics(name, odometer.counts, ENERGY, last - first, flight.groups_explored)
        self.put(PATHS.landing(number, name), Landing(agent=name, metrics=metrics))
        return metrics

    def visit(self, flight: Flight, odometer: Odometer, number: int) -> Record:
        odometer.arrive()
        arrived_s, cell = odometer.time_s, flight.cell
        if flight.wants_capture():
            odometer.capture()
        energy_j = odometer.energy_j
        scores = [uniform(7, number, flight.agent, flight.step, move) for move in range(len(MOVES))]
        decision = flight.decide(lambda: scores, reward=0.5)
        if decision.move != LAND:
            odometer.move(decision.move)
        row, column = self.layout.grid.position(cell)
        return Record(
            step=decision.step,
            cell=cell,
            row=row,
            column=column,
            captured=decision.captured,
            ssv=(float(self.exg[cell]),) if decision.captured else (),
            legal=decision.legal,
            move=decision.move,
            action="Land" if decision.move == LAND else MOVES[decision.move].value,
            time_s=arrived_s,
            uav_energy_j=energy_j,
        )

    def evaluate(self, number: int, metrics: Metrics) -> None:
        states = np.array(sorted(self.captured(number)), dtype=np.int64)
        fs = FeatureSpace(("exg",), states, self.exg[states, None], self.environment)
        predicted = extrapolate(yield_map(fs), self.environment.grid, Extrapolation.NEIGHBOUR_MEAN).values
        numbers = evaluation_metrics(predicted, fs, metrics)
        evaluation = MissionEvaluation(
            number=number,
            context="field",
            metrics=numbers,
            goals=judge(SPEC.spec.goals, numbers),
            agents=metrics.agents,
        )
        buffer = io.BytesIO()
        grades = classes(predicted, class_mean(predicted, self.environment))
        np.savez_compressed(buffer, allow_pickle=False, predicted=predicted, **{"class": grades})
        self.storage.write(PATHS.artefacts(number), buffer.getvalue())
        self.put(PATHS.evaluation(number), evaluation)

    def captured(self, number: int) -> set[int]:
        return set(collect(self.storage, PATHS).missions[number - 1].captured)

    def put(self, path: str, document: Model) -> None:
        self.storage.write(path, document.model_dump_json(by_alias=True).encode())


@pytest.fixture
def paths() -> FleetPaths:
    return PATHS


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the storage of a run of two missions out of three; copy it before changing it."""
    folder = tmp_path_factory.mktemp("finished")
    RunOfTwoMissions(LocalStorage(folder)).write()
    return folder


@pytest.fixture(scope="session")
def report(finished_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of that run's report, for tests that only read it."""
    return write_report(LocalStorage(finished_run), PATHS, tmp_path_factory.mktemp("report")).parent


@pytest.fixture
def storage(finished_run: Path, tmp_path: Path) -> LocalStorage:
    """A storage with the run, for one test to change."""
    shutil.copytree(finished_run, tmp_path / "storage")
    return LocalStorage(tmp_path / "storage")

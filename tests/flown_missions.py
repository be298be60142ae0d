"""Missions flown by the platform's own pilots in this process, as they leave them in storage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fleet.contexts.base import Environment
from fleet.contexts.grid import Grid
from fleet.functions import wire
from fleet.learning.model import Fit, SAModel, Transitions
from fleet.learning.models import blank_model
from fleet.learning.reward import Normaliser, RewardModel
from fleet.missions.documents import MissionOrder, ModelReference
from fleet.missions.layout import MOVES
from fleet.runtime.pilot import Pilot
from fleet.runtime.settings import Settings
from fleet.spec.base import Model
from fleet.spec.resources import FleetSpec
from fleet.storage.layout import FleetPaths
from fleet.storage.local import LocalStorage

PATHS = FleetPaths("default", "plots")
FEATURES = ("exg", "brightness")
GRID = Grid(np.array([[(row, column) not in {(1, 2), (4, 4), (4, 5)} for column in range(9)] for row in range(6)]))
SSV = np.random.default_rng(3).uniform(0, 1, (GRID.cells, len(FEATURES)))
REWARD = RewardModel(
    features=FEATURES, weights=(0.6, 0.3), normaliser=Normaliser(low=(0.0, 0.0), high=(1.0, 1.0)),
    utility_threshold=3.2, visited_threshold=7, loss=0.0, goals_met=True,
)  # fmt: skip
WEIGHTS = {"agent-1": {"initial": 0.25, "1": 0.75, "2": 0.0}, "agent-2": {"initial": 0.5, "1": 0.2, "2": 0.3}}


def fly_missions(folder: Path, missions: int = 2, **changes: Any) -> LocalStorage:
    """Fly two agents over a small field with holes; `changes` replace parts of the FleetSpec's spec."""
    storage = LocalStorage(folder)
    put(storage, PATHS.fleet_spec, spec_of(**changes))
    put(storage, PATHS.reward, REWARD)
    references = []
    for seed, key in enumerate(("initial", "1", "2")):
        references.append(ModelReference(key=key, path=f"{PATHS.root}/models/{key}.npz"))
        storage.write(references[-1].path, model(seed).to_bytes())
    for number in range(1, missions + 1):
        order = MissionOrder(number=number, context="field", seed=5, models=tuple(references), weights=WEIGHTS)
        put(storage, PATHS.plan(number), order)
        storage.write(PATHS.environment(number), wire.dump(wire.encode_environment(environment())))
        for agent in WEIGHTS:
            fly(settings_of(storage, agent, number))
    return storage


def settings_of(storage: LocalStorage, agent: str, mission: int) -> Settings:
    return Settings(storage.uri, PATHS.namespace, PATHS.fleet, mission=mission, agent=agent)


def fly(settings: Settings) -> None:
    """From take-off to landing; when Eval() is asked, it says finished after 8 captures."""
    pilot = Pilot(settings, environment())
    while not pilot.landed:
        ssv = SSV[pilot.cell] if pilot.wants_capture() else None
        record = pilot.visit(ssv, lambda: pilot.metrics.captures >= 8)
        settings.storage.append(settings.paths.log(settings.mission, settings.agent), record.to_line())


def spec_of(**changes: Any) -> FleetSpec:
    spec: dict[str, Any] = {
        "agents": {"count": 2},
        "stateSpace": {"context": "field", "groups": {"rows": 3, "columns": 3}},
        "map": {"function": "own:map_observation"},
        "eval": {"function": "own:evaluate"},
        "contexts": [{"name": "field", "uri": "field", "use": ["Mission"]}],
        "goals": [{"metric": "accuracy", "atLeast": 0.7}],
        **changes,
    }
    return FleetSpec.model_validate({"metadata": {"name": "plots"}, "spec": spec})


def model(seed: int) -> SAModel:
    """A model that has learned from moves made up at random."""
    generator = np.random.default_rng(seed)
    ssv = generator.uniform(0, 1, (2, 200, len(FEATURES)))
    moves = generator.integers(0, 4, 200)
    legal = generator.uniform(size=(200, len(MOVES))) < 0.5
    transitions = Transitions(ssv[0], moves, generator.uniform(0, 1, 200), ssv[1], legal)
    return blank_model(spec_of().spec.sa, FEATURES, REWARD.normaliser, seed).updated(transitions, Fit(epochs=3))


def environment() -> Environment:
    return Environment("field", "2018-06-01", GRID, "exg", SSV[:, 0].reshape(GRID.rows, GRID.columns))


def put(storage: LocalStorage, path: str, document: Model) -> None:
    storage.write(path, document.model_dump_json(by_alias=True).encode())

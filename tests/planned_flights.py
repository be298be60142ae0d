"""Missions that agents plan together, flown by the platform's own pilots in threads of this process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from fleet.contexts.base import Environment
from fleet.energy.model import energy_model
from fleet.functions import wire
from fleet.functions.belief import Belief
from fleet.learning.planner import PlannerModel
from fleet.learning.reward import Normaliser, PlannerReward, RewardModel
from fleet.missions.documents import Landing, MissionOrder, ModelReference
from fleet.missions.layout import layout_of
from fleet.missions.records import Record, read_log
from fleet.planning.scouting import Scout
from fleet.planning.swarm import Swarm
from fleet.planning.tactics import InterestWeights, Tactics
from fleet.runtime.pilot import Pilot
from fleet.runtime.settings import Settings
from fleet.spec.base import Model
from fleet.spec.resources import FleetSpec
from fleet.storage.layout import FleetPaths
from fleet.storage.local import LocalStorage
from tests.planning import Values, drawn, environment

PATHS = FleetPaths("default", "planners")
FEATURES = ("brightness", "exg")
WEIGHTS = InterestWeights(doubt=1.0, doubt_around=0.5, novelty=0.2)
REWARD = RewardModel(
    features=FEATURES, weights=(0.0, 0.0), normaliser=Normaliser(low=(0.0, 0.0), high=(1.0, 200.0)),
    utility_threshold=0.0, visited_threshold=0, loss=0.0, goals_met=True,
    planner=PlannerReward(feature="exg", weights=WEIGHTS, goal=0.6, caution=0.5),
)  # fmt: skip
Step = Callable[[Pilot, Record], None]
"""Told of each state of an agent, once its record is durable."""


def prepared(folder: Path, agents: int = 3, truth: Values | None = None, **changes: Any) -> LocalStorage:
    """Storage of a mission that nobody has flown yet; `changes` replace parts of the FleetSpec's spec."""
    storage, place = LocalStorage(folder), environment(drawn(1, 14, 16) if truth is None else truth)
    spec = spec_of(agents, **changes)
    put(storage, PATHS.fleet_spec, spec)
    put(storage, PATHS.reward, REWARD)
    storage.write(PATHS.initial_model, PlannerModel.blank(FEATURES, WEIGHTS).to_bytes())
    names = [agent.name for agent in spec.spec.agents.resolved]
    order = MissionOrder(
        number=1, context="field", seed=5, models=(ModelReference(key="initial", path=PATHS.initial_model),),
        weights={name: {"initial": 1.0} for name in names},
    )  # fmt: skip
    put(storage, PATHS.plan(1), order)
    storage.write(PATHS.environment(1), wire.dump(wire.encode_environment(place)))
    return storage


def fly(storage: LocalStorage, agents: Sequence[str] | None = None, step: Step = lambda *_: None) -> None:
    """Fly the mission of some agents, all by default, each in a thread of its own, from wherever their logs end."""
    spec = FleetSpec.model_validate_json(storage.read(PATHS.fleet_spec))
    names = agents or [agent.name for agent in spec.spec.agents.resolved]
    with ThreadPoolExecutor(len(names)) as pool:
        for done in [pool.submit(fly_one, storage, name, step) for name in names]:
            done.result()


def fly_one(storage: LocalStorage, agent: str, step: Step = lambda *_: None) -> None:
    """Fly one agent to its landing, and leave that in storage."""
    settings = settings_of(storage, agent)
    place = wire.decode_environment(wire.load(storage.read(PATHS.environment(1))))
    pilot = Pilot(settings, place)
    pilot.replay(log_of(storage, agent))
    while not pilot.landed:
        record = pilot.visit(sensed(place, pilot.cell) if pilot.wants_capture() else None)
        storage.append(PATHS.log(1, agent), record.to_line())
        step(pilot, record)
    put(storage, PATHS.landing(1, agent), Landing(agent=agent, metrics=pilot.metrics))


def simulated(storage: LocalStorage) -> Swarm:
    """The same mission in the simulator, where agents hear of each other at once."""
    fleet = FleetSpec.model_validate_json(storage.read(PATHS.fleet_spec)).spec
    place = wire.decode_environment(wire.load(storage.read(PATHS.environment(1))))
    scouts = [Scout(start) for start in layout_of(place.grid, fleet).starts]
    tactics = Tactics(weights=PlannerModel.blank(FEATURES, WEIGHTS).interest)
    swarm = Swarm(Belief(place.grid), energy_model(fleet), scouts, tactics, REWARD.of_planner.rule)
    swarm.fly(lambda cell: float(sensed(place, cell)[1]))
    return swarm


def sensed(place: Environment, cell: int) -> Values:
    """The SSV of a cell."""
    assert place.truth is not None
    return np.array([0.5, place.truth.flat[cell]])


def log_of(storage: LocalStorage, agent: str) -> tuple[Record, ...]:
    """An agent's log; empty when there is none."""
    path = PATHS.log(1, agent)
    return read_log(storage.read(path)) if storage.exists(path) else ()


def settings_of(storage: LocalStorage, agent: str) -> Settings:
    """Of an agent in the mission."""
    return Settings(storage.uri, PATHS.namespace, PATHS.fleet, mission=1, agent=agent)


def spec_of(agents: int, **changes: Any) -> FleetSpec:
    """A FleetSpec with a Planner."""
    spec: dict[str, Any] = {
        "agents": {"count": agents},
        "stateSpace": {"context": "field"},
        "map": {"function": "own:map_observation"},
        "eval": {"function": "own:evaluate"},
        "contexts": [{"name": "field", "uri": "field", "use": ["Mission"]}],
        "goals": [{"metric": "accuracy", "atLeast": 0.6}],
        "sa": {"kind": "Planner"},
        **changes,
    }
    return FleetSpec.model_validate({"metadata": {"name": "planners"}, "spec": spec})


def put(storage: LocalStorage, path: str, document: Model) -> None:
    storage.write(path, document.model_dump_json(by_alias=True).encode())

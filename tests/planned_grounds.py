"""Small made-up fields for a Planner to learn on, and an Eval() that can be sent to worker processes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fleet.functions.classes import class_mean, likely_values
from fleet.functions.contract import Evaluation, FeatureSpace, Metrics
from fleet.functions.evaluation import evaluation_metrics
from fleet.functions.extrapolation import extrapolate
from fleet.learning.practice import Grounds
from fleet.missions.layout import layout_of
from fleet.simulator.terrain import Terrain
from fleet.spec.resources import Fleet
from tests.planning import ENERGY, Values, drawn, environment

FEATURES = ("brightness", "exg")


@dataclass(frozen=True)
class KrigedMap:
    """Eval(): accuracy of the kriged map of excess green, and what it took."""

    version: str = "1"

    def evaluate(self, fs: FeatureSpace, metrics: Metrics, agent: str = "") -> Evaluation:
        place = fs.environment
        prediction = extrapolate(fs.grid_of("exg"), place.grid, expected=place.expected)
        predicted = likely_values(prediction, class_mean(prediction.values, place))
        return Evaluation(finished=metrics.explored, metrics=evaluation_metrics(predicted, fs, metrics))


def planner_fleet(**changes: Any) -> Fleet:
    """A FleetSpec with a Planner; little of everything, so that tests are quick."""
    document: dict[str, Any] = {
        "agents": {"count": 2},
        "stateSpace": {"context": "field"},
        "map": {"function": "field:map_observation"},
        "eval": {"function": "field:evaluate"},
        "contexts": [{"name": "field", "uri": "field"}],
        "goals": [{"metric": "accuracy", "atLeast": 0.6}],
        "sa": {"kind": "Planner"},
        "ha": {"confidence": 0.75},
        "rewardShaping": {"epochs": 8, "batch": 3},
    }
    return Fleet.model_validate(document | changes)


def planner_terrain(fleet: Fleet, truth: Values) -> Terrain:
    """A field whose excess green is its truth; brightness says nothing."""
    place = environment(truth)
    ssv = np.stack((np.random.default_rng(0).uniform(size=truth.size), truth.reshape(-1)), axis=1)
    ssv[~np.isfinite(truth.reshape(-1))] = np.nan
    return Terrain(place, FEATURES, ssv, layout_of(place.grid, fleet))


def planner_grounds(fleet: Fleet, *truths: Values) -> Grounds:
    """Some fields; two that differ when none is given."""
    fields = truths or (drawn(1, 9, 11), drawn(2, 10, 8))
    terrains = tuple(planner_terrain(fleet, truth) for truth in fields)
    return Grounds(terrains, tuple(agent.name for agent in fleet.agents.resolved), ENERGY, KrigedMap())

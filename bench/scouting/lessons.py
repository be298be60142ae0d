"""What the paper's swarm learns on other fields before it flies one: reward, thresholds and SA, by the platform's code.

Agents fly 3x3 groups in serpentine order; SA is Q-learning; reward shaping finds feature weights, T_u and T_v on one
part of the known fields, and SA is trained on the other part (paper, section "Reward Shaping and Training"). The SSV
of a cell is its quantity, and on the corn field leaf area and brightness too, in standard deviations from the field's
mean: absolute values differ between dates by more than they vary in a field. That the flown field's mean and
deviation are known is in favour of this swarm.
"""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.scouting.campaign import known
from bench.scouting.fields import CORN, MADE_UP, NOISE, PLANTED, REAL, Field, data_folder
from bench.scouting.flight import ENERGY
from bench.scouting.judge import How, accuracies
from fleet.functions.contract import Evaluation, FeatureSpace, Metrics
from fleet.functions.evaluation import cost_metrics
from fleet.learning.model import SAModel
from fleet.learning.practice import Grounds
from fleet.learning.reward import Normaliser, RewardModel
from fleet.learning.run import Run
from fleet.learning.shaping import shape
from fleet.learning.training import train
from fleet.missions.layout import plan_layout
from fleet.simulator.terrain import Terrain
from fleet.spec.resources import Fleet
from fleet.storage.local import LocalStorage

Values = NDArray[np.float64]
QUANTITY = ("quantity",)
CORN_FEATURES = ("exg", "lai", "brightness")
QUICK: Mapping[str, object] = {
    "rewardShaping": {"epochs": 16, "missions": 64},
    "training": {"epochs": 2, "missions": 128},
}
"""A FleetSpec's settings for the short form of benchmarks."""
_OTHER_MADE_UP = (1_000_003, 1_000_005)
"""Seeds of the made-up fields that are known before another one is flown."""


@dataclass(frozen=True)
class Course:
    """What is learned, and for what.

    Args:
        field: The field that will be flown; nothing is learned on it.
        agents: How many fly.
        goal: Accuracy to reach.
        how: From captured cells to a map, in Eval().
        seed: Of everything random.
        settings: Parts of the FleetSpec that are not the default.
    """

    field: str
    agents: int
    goal: float
    how: How = How.NM
    seed: int = 0
    settings: Mapping[str, object] = field(default_factory=dict, hash=False)


@dataclass(frozen=True, eq=False)
class Learned:
    """What was learned.

    Args:
        reward: Reward and thresholds.
        model: SA.
        terrain: The field that will be flown.
    """

    reward: RewardModel
    model: SAModel
    terrain: Terrain


@dataclass(frozen=True)
class Judge:
    """Eval(): accuracy of the map of the captured cells; an `EvalClient`."""

    how: How

    @property
    def version(self) -> str:
        """Differs for another kind of map."""
        return self.how.value

    def evaluate(self, fs: FeatureSpace, metrics: Metrics, agent: str = "") -> Evaluation:
        """Judge a mission."""
        captured = np.zeros(fs.environment.grid.cells, dtype=np.bool_)
        captured[fs.states] = True
        found = accuracies(Field(fs.environment), captured, (self.how,))
        return Evaluation(metrics.explored, {"accuracy": found[self.how], **cost_metrics(metrics)})


def learn(course: Course) -> Learned:
    """Shape a reward and train SA on fields other than the one that will be flown.

    Raises:
        TrainingError: the settings leave nothing to learn from.
        SpecError: the settings are not those of a FleetSpec.
    """
    fleet = fleet_of(course)
    features = CORN_FEATURES if course.field in CORN else QUANTITY
    shaped, trained = (
        Grounds(
            tuple(terrain(fleet, place, features) for place in places),
            tuple(agent.name for agent in fleet.agents.resolved),
            ENERGY,
            Judge(course.how),
        )
        for places in contexts(course.field)
    )
    normaliser = Normaliser.over([each.ssv for each in (*shaped.terrains, *trained.terrains)])
    with tempfile.TemporaryDirectory() as folder:
        run = Run(LocalStorage(Path(folder)), "lessons", course.seed)
        reward = shape(fleet, shaped, run, normaliser)
        model = train(fleet, trained, reward, run)
    return Learned(reward, model, terrain(fleet, known(course.field, 0), features))


def fleet_of(course: Course) -> Fleet:
    """The FleetSpec: the paper's groups, the platform's defaults, and the course's settings over them."""
    document = {
        "agents": {"count": course.agents},
        "stateSpace": {"context": "field", "captureInTransit": False},
        "map": {"function": "field:map"},
        "eval": {"function": "field:evaluate"},
        "contexts": [{"name": "field", "uri": "field"}],
        "goals": [{"metric": "accuracy", "atLeast": course.goal}],
    }
    return Fleet.model_validate(document | dict(course.settings))


def contexts(name: str) -> tuple[list[Field], list[Field]]:
    """The fields for shaping and those for training; never the flown one.

    Other dates of the corn field for one of its dates, all other real fields for another real one: another season of
    the same field too, as in the paper. Both parts get some of each kind, by turns.
    """
    if name in MADE_UP:
        first, second = (known(NOISE if name == NOISE else PLANTED, seed) for seed in _OTHER_MADE_UP)
        return [first], [second]
    kin = CORN if name in CORN else REAL
    at = kin.index(name)
    rest = [known(other, 0) for other in (*kin[at + 1 :], *kin[:at])]
    return rest[::2], rest[1::2]


def terrain(fleet: Fleet, place: Field, features: tuple[str, ...]) -> Terrain:
    """A field as missions see it, its features in standard deviations from their mean."""
    found = quantities(place, features)
    ssv = (found - np.nanmean(found, axis=0)) / np.nanstd(found, axis=0)
    layout = plan_layout(place.grid, fleet.state_space, fleet.agents.resolved)
    return Terrain(place.environment, features, ssv, layout)


def quantities(place: Field, features: tuple[str, ...]) -> Values:
    """The features of each cell in their own units, the quantity first, float64 [cells, features]; NaN without data."""
    return np.column_stack([place.truth] if features == QUANTITY else _corn_columns(place.name))


@cache
def _corn_columns(date: str) -> tuple[Values, ...]:
    """CORN_FEATURES of a date, each float64 [cells], the mean of the pictures in each cell; NaN without data."""
    grid = known(date, 0).grid
    with (data_folder() / "corn-cube" / f"{date}.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    cells = np.array([int(row["row"]) * grid.columns + int(row["col"]) for row in rows])
    count = np.bincount(cells, minlength=grid.cells)
    found = []
    for name in CORN_FEATURES:
        total = np.bincount(cells, [float(row[name]) for row in rows], minlength=grid.cells)
        found.append(np.where(count > 0, total / np.maximum(count, 1), np.nan))
    return tuple(found)

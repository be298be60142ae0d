"""How cautious a Planner is to be, found again by a plain search over missions that are flown here."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from fleet.errors import ModelError, TrainingError
from fleet.functions.belief import Belief
from fleet.functions.contract import Evaluation, FeatureSpace, Metrics
from fleet.learning.goals import Objective
from fleet.learning.practice import Grounds
from fleet.learning.progress import Progress
from fleet.learning.rehearsals import given_planner, planner_reward, shape_planner
from fleet.learning.reward import Normaliser, PlannerReward, RewardModel
from fleet.learning.run import Run
from fleet.missions.accounting import thorough_metrics
from fleet.missions.odometer import Odometer
from fleet.planning.stop import CAUTIONS, usual_caution
from fleet.planning.swarm import Swarm, scattered
from fleet.planning.tactics import InterestWeights, Tactics
from fleet.randomness import named_seed
from fleet.spec.resources import Fleet
from fleet.storage.local import LocalStorage
from tests.planned_grounds import FEATURES, KrigedMap, planner_fleet, planner_grounds
from tests.planning import ENERGY, drawn

NORMALISER = Normaliser(low=(0.0, 0.0), high=(1.0, 200.0))
SEED = 3


def shaped(folder: Path, fleet: Fleet, grounds: Grounds, workers: int = 1) -> tuple[RewardModel, list[Progress]]:
    news: list[Progress] = []
    run = Run(LocalStorage(folder), "shaping", SEED, workers, listener=news.append)
    return shape_planner(fleet, grounds, run, NORMALISER), news


# a plain search


@dataclass
class Moment:
    """What a mission had claimed and reached when an agent looked at its map."""

    claimed: float
    predictions: int
    accuracy: float
    energy_j: float


def flown(grounds: Grounds, number: int, weights: InterestWeights) -> list[Moment]:
    """A mission of two agents until every cell is captured, moment by moment."""
    terrain = grounds.terrains[number % len(grounds.terrains)]
    place = terrain.environment
    assert place.truth is not None
    scouts = scattered(place.grid, 2, named_seed(named_seed(SEED, "shaping/rehearsals"), f"{number}"))
    swarm, moments = Swarm(Belief(place.grid), ENERGY, scouts, Tactics(weights=weights)), list[Moment]()

    def watch() -> bool:
        cells = np.sort(np.array(swarm.captured))
        space = FeatureSpace(FEATURES, cells, terrain.ssv[cells], place)
        found = KrigedMap().evaluate(space, thorough_metrics(terrain.layout, grounds.agents, ENERGY)).metrics
        claim = swarm.claims[-1]
        moments.append(Moment(claim.accuracy, claim.predictions, found["accuracy"], swarm.spent_j))
        return False

    swarm.fly(place.truth.item, watch)
    return moments


def where_it_ends(moments: list[Moment], goal: float, caution: float) -> Moment:
    for moment in moments:
        enough = moment.predictions and moment.claimed >= goal + 0.01 + caution / np.sqrt(moment.predictions)
        if enough:
            return moment
    return moments[-1]


def least_caution(
    missions: list[list[Moment]], goal: float, margin: float, confidence: float
) -> tuple[float, list[Moment], int]:
    """The least caution with which enough missions end with the goal met, their ends, and how many met it."""
    for step in range(61):
        ends = [where_it_ends(moments, goal, step * 0.05) for moments in missions]
        met = sum(end.accuracy >= goal * (1.0 + margin) for end in ends)
        if met >= confidence * len(missions):
            break
    return step * 0.05, ends, met


def full_j(grounds: Grounds, number: int) -> float:
    """Energy of visiting every cell without a detour."""
    terrain = grounds.terrains[number % len(grounds.terrains)]
    return thorough_metrics(terrain.layout, grounds.agents, ENERGY).uav_energy_j


@pytest.mark.parametrize(("goal", "confidence"), [(0.6, 0.75), (0.7, 1.0)])
def test_the_rule_is_the_least_cautious_one_with_which_enough_missions_met_the_goal(
    tmp_path: Path, goal: float, confidence: float
) -> None:
    goals = [{"metric": "accuracy", "atLeast": goal}]
    fleet = planner_fleet(goals=goals, ha={"confidence": confidence})
    grounds = planner_grounds(fleet)
    found, _ = shaped(tmp_path, fleet, grounds)
    missions = [flown(grounds, number, InterestWeights()) for number in range(8)]
    caution, ends, met = least_caution(missions, goal, margin=0.02, confidence=confidence)
    planner = PlannerReward(feature="exg", weights=InterestWeights(), goal=goal, caution=found.of_planner.caution)
    assert found.of_planner == planner
    assert planner.caution == pytest.approx(caution)
    assert caution > 0.0, "the fields are not of those that this test is about"
    assert (found.evaluations, found.successes, found.goals_met) == (8, met, True)
    objective = Objective(fleet.goals, "uav_energy_j", 0.02)
    losses = [
        objective.loss({"accuracy": end.accuracy, "uav_energy_j": end.energy_j}, full_j(grounds, number))
        for number, end in enumerate(ends)
    ]
    assert found.loss == pytest.approx(np.mean(losses))


def test_more_confidence_takes_more_caution(tmp_path: Path) -> None:
    cautions = []
    for confidence in (0.5, 1.0):
        goals = [{"metric": "accuracy", "atLeast": 0.7}]
        fleet = planner_fleet(goals=goals, ha={"confidence": confidence})
        cautions.append(shaped(tmp_path, fleet, planner_grounds(fleet))[0].of_planner.caution)
    assert cautions[0] < cautions[1]


def test_what_a_mission_has_spent_is_what_its_odometers_say_and_the_landings() -> None:
    fleet = planner_fleet()
    grounds = planner_grounds(fleet)
    grid = grounds.terrains[0].environment.grid
    swarm = Swarm(Belief(grid), ENERGY, scattered(grid, 2, 1), Tactics())
    swarm.fly(drawn(1, 9, 11).item)
    odometers: list[Odometer] = [trace.odometer for trace in swarm.traces]
    assert swarm.spent_j == pytest.approx(sum(one.energy_j for one in odometers) + 2 * ENERGY.land().energy_j)


def test_a_caution_that_is_given_is_kept_and_only_judged(tmp_path: Path) -> None:
    fleet = planner_fleet(ha={"caution": 0.0, "confidence": 1.0}, goals=[{"metric": "accuracy", "atLeast": 0.7}])
    grounds = planner_grounds(fleet)
    found, news = shaped(tmp_path, fleet, grounds)
    ends = [where_it_ends(flown(grounds, number, InterestWeights()), 0.7, 0.0) for number in range(8)]
    met = sum(end.accuracy >= 0.7 * 1.02 for end in ends)
    assert met < 8, "the field is not of those that this test is about"
    assert (found.of_planner.caution, found.successes, found.goals_met) == (0.0, met, False)
    assert news[-1].message == "fewer than 100% of the rehearsed missions met every goal, however cautious"


def test_a_goal_that_cannot_be_reached_takes_the_most_caution_and_is_told(tmp_path: Path) -> None:
    goals = [{"metric": "accuracy", "atLeast": 0.6}, {"metric": "uav_energy_j", "atMost": 1.0}]
    fleet = planner_fleet(goals=goals)
    found, news = shaped(tmp_path, fleet, planner_grounds(fleet))
    assert (found.of_planner.caution, found.goals_met, found.successes) == (CAUTIONS[-1], False, 0)
    assert found.loss > 1.0
    assert (news[-1].goals_met, news[-1].message) == (
        False,
        "fewer than 75% of the rehearsed missions met every goal, however cautious",
    )
    assert [one.message for one in news[:-1]] == [""] * (len(news) - 1)


def test_a_metric_that_eval_does_not_give_is_told_before_anything_is_flown(tmp_path: Path) -> None:
    goals = [{"metric": "accuracy", "atLeast": 0.6}, {"metric": "yield_t", "atLeast": 1.0}]
    fleet = planner_fleet(goals=goals)
    with pytest.raises(TrainingError, match=r"spec\.goals asks for yield_t, but Eval\(\) gives no such metric"):
        shaped(tmp_path, fleet, planner_grounds(fleet))


def test_the_number_of_workers_does_not_change_the_reward(tmp_path: Path) -> None:
    fleet = planner_fleet(rewardShaping={"epochs": 4, "batch": 3})
    one, two = (shaped(tmp_path, fleet, planner_grounds(fleet), workers) for workers in (1, 2))
    assert one == two
    assert [news.done for news in one[1]] == [3, 4]
    other = Run(LocalStorage(tmp_path), "shaping", SEED + 1)
    assert shape_planner(fleet, planner_grounds(fleet), other, NORMALISER).loss != one[0].loss


def test_every_context_is_rehearsed_however_few_missions_are_asked_for(tmp_path: Path) -> None:
    fleet = planner_fleet(rewardShaping={"epochs": 1, "batch": 1})
    assert shaped(tmp_path, fleet, planner_grounds(fleet))[0].evaluations == 2
    longer = planner_fleet(rewardShaping={"epochs": 2, "periods": 2})
    assert shaped(tmp_path, longer, planner_grounds(longer))[0].evaluations == 4


# what is given


def test_without_a_shaping_context_the_caution_is_the_usual_one_or_the_given_one(tmp_path: Path) -> None:
    usual = given_planner(planner_fleet(sa={"kind": "Planner", "feature": "exg"}), FEATURES, NORMALISER)
    assert usual.of_planner == PlannerReward(
        feature="exg", weights=InterestWeights(), goal=0.6, caution=usual_caution(0.6)
    )
    assert (usual.features, usual.normaliser, usual.evaluations, usual.goals_met) == (FEATURES, NORMALISER, 0, False)
    given = given_planner(planner_fleet(ha={"caution": 1.25}), FEATURES, NORMALISER)
    assert given.of_planner.caution == 1.25
    nowhere = Grounds((), ("agent-1", "agent-2"), ENERGY, KrigedMap())
    with pytest.raises(TrainingError, match="no context is for shaping; give one of `contexts` the use Shaping"):
        shaped(tmp_path, planner_fleet(), nowhere)


def test_the_usual_caution_falls_with_the_goal_and_is_never_none() -> None:
    assert [usual_caution(goal) for goal in (0.1, 0.7, 0.8, 0.9, 1.0)] == pytest.approx([3.0, 1.5, 1.0, 0.5, 0.5])


def test_weights_that_are_given_are_taken_and_the_others_are_the_usual_ones() -> None:
    fleet = planner_fleet(rewardShaping={"weights": {"novelty": 0.9, "doubt": 0.0}})
    found = planner_reward(fleet, FEATURES, "exg")
    assert found.weights == InterestWeights(doubt=0.0, doubt_around=1.0, novelty=0.9)


@pytest.mark.parametrize(
    ("feature", "truth_name", "mapped"),
    [
        (None, "exg", "exg"),
        (None, "", "brightness"),
        (None, "yield", "brightness"),
        ("brightness", "exg", "brightness"),
    ],
)
def test_what_is_mapped_is_what_is_named_or_known_to_be_true_or_the_first(
    feature: str | None, truth_name: str, mapped: str
) -> None:
    fleet = planner_fleet(sa={"kind": "Planner", "feature": feature})
    assert planner_reward(fleet, FEATURES, truth_name).feature == mapped


def test_a_feature_that_map_does_not_give_is_named_with_those_that_it_gives() -> None:
    fleet = planner_fleet(sa={"kind": "Planner", "feature": "ndvi"})
    with pytest.raises(ModelError) as told:
        planner_reward(fleet, FEATURES, "exg")
    assert str(told.value) == "sa.feature is ndvi, but Map() gives brightness, exg; name one of these"


def test_a_weight_that_a_planner_does_not_have_is_named_with_those_that_it_has() -> None:
    fleet = planner_fleet(rewardShaping={"weights": {"exg": 0.5, "doubt": 0.5, "brightness": 0.1}})
    with pytest.raises(ModelError) as told:
        planner_reward(fleet, FEATURES, "exg")
    assert str(told.value) == (
        "rewardShaping.weights names brightness, exg; a Planner weighs doubt, doubt_around, novelty"
    )


def test_a_planner_without_a_goal_for_accuracy_is_told_to_have_one() -> None:
    fleet = planner_fleet(goals=[{"metric": "coverage", "atLeast": 0.5}])
    with pytest.raises(TrainingError, match="no goal says so; add one for accuracy"):
        planner_reward(fleet, FEATURES, "exg")


def test_a_reward_for_state_groups_is_none_of_a_planner() -> None:
    groups = given_planner(planner_fleet(), FEATURES, NORMALISER).model_copy(update={"planner": None})
    with pytest.raises(TrainingError, match=r"shaped for state groups, and sa\.kind is Planner; train again"):
        _ = groups.of_planner


class Forgetful(KrigedMap):
    """An Eval() that makes its map of captured cells alone."""

    def evaluate(self, fs: FeatureSpace, metrics: Metrics, agent: str = "") -> Evaluation:
        return super().evaluate(replace(fs, environment=replace(fs.environment, expected=None)), metrics, agent)


@pytest.mark.parametrize(("evaluator", "expects"), [(KrigedMap(), True), (Forgetful(), False)])
def test_missions_expect_nothing_where_eval_makes_no_use_of_it(
    tmp_path: Path, evaluator: KrigedMap, expects: bool
) -> None:
    fleet = planner_fleet()
    found, _ = shaped(tmp_path, fleet, replace(planner_grounds(fleet), evaluator=evaluator))
    assert found.of_planner.expects is expects

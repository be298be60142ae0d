from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from fleet.errors import CallSite, FunctionError, ModelError, TrainingError
from fleet.functions.contract import Evaluation, FeatureSpace, Metrics
from fleet.learning.bayes import Dimension
from fleet.learning.models import blank_model
from fleet.learning.practice import Grounds, Practice, practise, visit_everything
from fleet.learning.progress import Progress
from fleet.learning.reward import Normaliser, RewardModel
from fleet.learning.run import Run
from fleet.learning.score_tables import ALONE, Flights, batch_of, reward_table, score_table
from fleet.learning.shaping import LEAST_SHARE, Trial, best_of, parameters, reward_of, shape
from fleet.missions.documents import INITIAL
from fleet.simulator.batch import fly
from fleet.storage.local import LocalStorage
from tests.learning_field import FEATURES, field_fleet, field_grounds


def run_in(folder: Path, seed: int = 1, workers: int = 1) -> tuple[Run, list[Progress]]:
    news: list[Progress] = []
    return Run(LocalStorage(folder), "shaping", seed, workers, listener=news.append), news


def test_weights_thresholds_and_the_share_of_what_a_group_can_give_are_shaped() -> None:
    assert parameters(field_fleet(), FEATURES) == (
        Dimension("weight of rich", 0.0, 1.0),
        Dimension("weight of row", 0.0, 1.0),
        Dimension("weight of column", 0.0, 1.0),
        Dimension("T_u as a share", LEAST_SHARE, 1.0, logarithmic=True),
        Dimension("T_v", 0, 8, integer=True),
    )


def test_the_utility_threshold_grows_with_what_a_group_can_give_unless_it_is_given() -> None:
    normaliser = Normaliser(low=(0.0,) * 3, high=(1.0,) * 3)
    for fleet, expected in ((field_fleet(), 0.25 * 1.5 * 9), (field_fleet(ha={"utilityThreshold": 0.25}), 0.25)):
        reward = reward_of(fleet, FEATURES, normaliser, Trial(0, (1.0, 0.5, 0.0, 0.25, 4), 0.4, True))
        assert (reward.weights, reward.utility_threshold, reward.visited_threshold) == ((1.0, 0.5, 0.0), expected, 4)


def test_what_the_spec_gives_is_not_shaped() -> None:
    fleet = field_fleet(ha={"utilityThreshold": 1.5, "visitedThreshold": 0}, rewardShaping={"weights": {"row": 0.25}})
    assert [d for d in parameters(fleet, FEATURES) if d.fixed] == [
        Dimension("weight of row", 0.25, 0.25),
        Dimension("T_u", 1.5, 1.5),
        Dimension("T_v", 0, 0, integer=True),
    ]


def test_a_weight_of_an_unknown_feature_is_an_error_that_lists_the_known_ones() -> None:
    with pytest.raises(TrainingError, match=r"names blue; write a feature that Map.. gives: rich, row, column"):
        parameters(field_fleet(rewardShaping={"weights": {"blue": 1.0}}), FEATURES)


def test_the_best_meets_the_goals_and_costs_least() -> None:
    trials = [Trial(0, (0.0,), loss, met) for loss, met in [(0.6, True), (1.01, False), (0.5, True), (0.5, True)]]
    assert best_of(trials) is trials[2]
    near = [Trial(0, (0.0,), 1.2, True), Trial(0, (0.0,), 1.1, False)]
    assert best_of(near) is near[0]


def test_shaping_finds_a_reward_that_meets_the_goals_and_tells_how_far_it_is(tmp_path: Path) -> None:
    fleet = field_fleet()
    grounds = field_grounds(fleet, contexts=2)
    run, news = run_in(tmp_path)
    reward = shape(fleet, grounds, run)
    assert reward.goals_met
    assert reward.loss < 1.0
    assert (reward.evaluations, reward.features) == (12, FEATURES)
    assert [(item.done, item.total) for item in news] == [(0, 12), (4, 12), (8, 12), (12, 12)]
    assert news[-1].best_loss == reward.loss
    trials = json.loads((tmp_path / "shaping" / "trials.json").read_bytes())["state"]["trials"]
    assert len(trials) == 12
    assert min(trial["loss"] for trial in trials) == reward.loss
    assert reward.successes == sum(trial["goals_met"] for trial in trials)
    assert trials[0]["point"] == [1 / 3, 1 / 3, 1 / 3, 1.0, 8]


def test_goals_that_cannot_be_met_give_the_best_seen_and_say_so(tmp_path: Path) -> None:
    fleet = field_fleet(goals=[{"metric": "found", "atLeast": 2.0}])
    run, news = run_in(tmp_path)
    reward = shape(fleet, field_grounds(fleet), run)
    assert not reward.goals_met
    assert reward.loss > 1.0
    assert news[-1].message == "no parameter set met every goal on every shaping context; the best seen is kept"


def test_with_everything_given_there_is_one_evaluation(tmp_path: Path) -> None:
    given = {"weights": dict.fromkeys(FEATURES, 0.5)}
    fleet = field_fleet(ha={"utilityThreshold": 3, "visitedThreshold": 8}, rewardShaping=given)
    reward = shape(fleet, field_grounds(fleet), run_in(tmp_path)[0])
    assert (reward.evaluations, reward.weights) == (1, (0.5, 0.5, 0.5))
    assert (reward.utility_threshold, reward.visited_threshold) == (3.0, 8)


def test_the_number_of_workers_does_not_change_the_result(tmp_path: Path) -> None:
    fleet = field_fleet()
    grounds = field_grounds(fleet)
    results = {shape(fleet, grounds, run_in(tmp_path / str(count), workers=count)[0]) for count in (1, 2, 3)}
    assert len(results) == 1


def test_a_second_period_looks_around_the_best_of_the_first(tmp_path: Path) -> None:
    fleet = field_fleet(rewardShaping={"epochs": 8, "batch": 4, "missions": 4, "periods": 2})
    shape(fleet, field_grounds(fleet), run_in(tmp_path)[0])
    trials = json.loads((tmp_path / "shaping" / "trials.json").read_bytes())["state"]["trials"]
    first, second = trials[:8], trials[8:]
    assert [trial["period"] for trial in trials] == [0] * 8 + [1] * 8
    best = min(first, key=lambda trial: (not trial["goals_met"], trial["loss"]))["point"]
    factor = LEAST_SHARE ** (1 / 4)
    for trial in second:
        *weights, _, visited = np.array(trial["point"]) - best
        assert (np.abs(weights) <= 0.25).all()
        assert factor - 1e-12 <= trial["point"][3] / best[3] <= 1 / factor + 1e-12
        assert abs(visited) <= 2


def test_a_finished_shaping_is_not_done_again_and_another_problem_is(tmp_path: Path) -> None:
    fleet = field_fleet()
    grounds = field_grounds(fleet)
    reward = shape(fleet, grounds, run_in(tmp_path)[0])
    run, news = run_in(tmp_path)
    assert shape(fleet, grounds, run) == reward
    assert [(item.done, item.message) for item in news] == [(12, "going on from a checkpoint")]
    run, news = run_in(tmp_path, seed=2)
    shape(fleet, grounds, run)
    assert news[0].done == 0


@pytest.mark.parametrize("broken", [b"", b"{", b"[]", b'{"fingerprint": 1}'])
def test_a_broken_checkpoint_counts_as_none(tmp_path: Path, broken: bytes) -> None:
    fleet = field_fleet(rewardShaping={"epochs": 4, "batch": 4, "missions": 2})
    LocalStorage(tmp_path).write("shaping/trials.json", broken)
    run, news = run_in(tmp_path)
    shape(fleet, field_grounds(fleet), run)
    assert [item.done for item in news] == [0, 4]


def test_without_a_context_shaping_says_what_to_write(tmp_path: Path) -> None:
    fleet = field_fleet()
    full = field_grounds(fleet)
    with pytest.raises(TrainingError, match="the use Shaping"):
        shape(fleet, Grounds((), full.agents, full.energy, full.evaluator), run_in(tmp_path)[0])


def test_a_pretrained_model_of_another_kind_is_refused(tmp_path: Path) -> None:
    fleet = field_fleet()
    grounds = field_grounds(fleet)
    model = blank_model(fleet.sa, FEATURES, Normaliser.over([terrain.ssv for terrain in grounds.terrains]), 0)
    run = Run(LocalStorage(tmp_path), "shaping", pretrained=model)
    with pytest.raises(ModelError, match=r"of kind QLearning, but sa.kind is DQN; write the model's kind there"):
        shape(field_fleet(sa={"kind": "DQN"}), grounds, run)


def test_a_pretrained_model_for_another_ssv_is_refused(tmp_path: Path) -> None:
    fleet = field_fleet()
    other = blank_model(fleet.sa, ("exg",), Normaliser(low=(0.0,), high=(1.0,)), 0)
    with pytest.raises(ModelError, match=r"expects the features exg, but Map.. gives rich, row, column"):
        shape(fleet, field_grounds(fleet), Run(LocalStorage(tmp_path), "shaping", pretrained=other))


class BrokenEval:
    """Fails as a user's Eval() does, after the retries of its client."""

    version = "1"

    def evaluate(self, fs: FeatureSpace, metrics: Metrics, agent: str = "") -> Evaluation:
        raise FunctionError("raised ValueError", CallSite("field:evaluate", agent, f"{len(fs)} states"))


@pytest.mark.parametrize("workers", [1, 2])
def test_an_eval_that_fails_ends_shaping_with_its_own_error(tmp_path: Path, workers: int) -> None:
    fleet = field_fleet()
    full = field_grounds(fleet)
    grounds = Grounds(full.terrains, full.agents, full.energy, BrokenEval())
    with pytest.raises(FunctionError, match=r"field:evaluate.*raised ValueError"):
        shape(fleet, grounds, run_in(tmp_path, workers=workers)[0])


def test_a_goal_whose_metric_eval_does_not_give_ends_shaping_at_once(tmp_path: Path) -> None:
    fleet = field_fleet(goals=[{"metric": "found", "atLeast": 0.6}, {"metric": "fuond", "atLeast": 0.6}])
    run, news = run_in(tmp_path)
    with pytest.raises(TrainingError, match=r"asks for fuond, but .* no such metric; it gives found, uav_energy_j: "):
        shape(fleet, field_grounds(fleet), run)
    assert [item.done for item in news] == [0]


def test_visiting_everything_captures_every_state() -> None:
    fleet = field_fleet()
    assert [metrics["found"] for metrics in visit_everything(field_grounds(fleet, contexts=2))] == [1.0, 1.0]


def test_practice_teaches_sa_to_seek_what_is_rewarded() -> None:
    fleet = field_fleet(stateSpace={"context": "field", "captureInTransit": False})
    grounds = field_grounds(fleet)
    terrain = grounds.terrains[0]
    reward = RewardModel(
        features=FEATURES, weights=(1.0, 0.0, 0.0), normaliser=Normaliser.over([terrain.ssv]), utility_threshold=3.0,
        visited_threshold=3, loss=0.0, goals_met=False,
    )  # fmt: skip
    blank = blank_model(fleet.sa, FEATURES, reward.normaliser, seed=0)
    learned = practise(blank, reward, grounds.terrains, Practice(256, 0.5, 0.5, seed=1))
    random = _mean_reward(np.zeros((108, 8)), reward, grounds, exploration=1.0)
    greedy = _mean_reward(score_table({INITIAL: learned}, ALONE, terrain), reward, grounds, exploration=0.0)
    assert greedy > 1.15 * random


def _mean_reward(table: np.ndarray, reward: RewardModel, grounds: Grounds, exploration: float) -> float:
    terrain = grounds.terrains[0]
    batch = batch_of(table, reward, terrain, Flights(count=32, exploration=exploration))
    captured = fly(terrain.layout, batch).captured
    rewards: Sequence[float] = [float(reward_table(reward, terrain)[cells].mean()) for cells in captured]
    return float(np.mean(rewards))

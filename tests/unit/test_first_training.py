from __future__ import annotations

import json
from pathlib import Path

import pytest

from fleet.errors import TrainingError
from fleet.learning.model import SAModel
from fleet.learning.models import blank_model
from fleet.learning.practice import Grounds, Practice, practise
from fleet.learning.progress import Progress
from fleet.learning.reward import Normaliser, RewardModel
from fleet.learning.run import Run
from fleet.learning.training import train
from fleet.spec.resources import Fleet
from fleet.storage.local import LocalStorage
from tests.learning_field import FEATURES, field_fleet, field_grounds


def reward_over(grounds: Grounds) -> RewardModel:
    return RewardModel(
        features=FEATURES, weights=(1.0, 0.1, 0.0), normaliser=Normaliser.over([t.ssv for t in grounds.terrains]),
        utility_threshold=2.5, visited_threshold=4, loss=0.4, goals_met=True,
    )  # fmt: skip


def trained(
    folder: Path, fleet: Fleet, workers: int = 1, pretrained: SAModel | None = None
) -> tuple[SAModel, list[Progress]]:
    news: list[Progress] = []
    grounds = field_grounds(fleet, contexts=2)
    run = Run(LocalStorage(folder), "training", 3, workers, pretrained, listener=news.append)
    return train(fleet, grounds, reward_over(grounds), run), news


def test_the_candidate_of_the_least_loss_is_kept(tmp_path: Path) -> None:
    _, news = trained(tmp_path, field_fleet())
    scores = json.loads((tmp_path / "training" / "candidates.json").read_bytes())["state"]["scores"]
    assert [item.done for item in news[:4]] == [0, 1, 2, 3]
    assert news[3].best_loss == min(score["loss"] for score in scores)
    assert {item.total for item in news} == {3}


@pytest.mark.parametrize("periods", [1, 2])
def test_the_number_of_workers_does_not_change_the_model(tmp_path: Path, periods: int) -> None:
    fleet = field_fleet(training={"epochs": 3, "missions": 8, "periods": periods})
    models = {trained(tmp_path / str(count), fleet, count)[0].to_bytes() for count in (1, 2)}
    assert len(models) == 1


def test_a_finished_training_is_not_done_again(tmp_path: Path) -> None:
    model, _ = trained(tmp_path, field_fleet())
    again, news = trained(tmp_path, field_fleet())
    assert again.to_bytes() == model.to_bytes()
    assert (news[0].done, news[0].message) == (3, "going on from a checkpoint")


def test_a_pretrained_model_that_is_as_good_is_kept(tmp_path: Path) -> None:
    fleet = field_fleet(ha={"visitedThreshold": 8}, goals=[{"metric": "found", "atLeast": 5.0}])
    grounds = field_grounds(fleet, contexts=2)
    reward = reward_over(grounds)
    start = blank_model(fleet.sa, FEATURES, reward.normaliser, 0)
    start = practise(start, reward, grounds.terrains, Practice(64, 0.5, 0.5, 0))
    unreachable = field_fleet(goals=[{"metric": "found", "atLeast": 1e300}])  # all models miss it alike
    model, news = trained(tmp_path, unreachable, pretrained=start)
    assert model.to_bytes() == start.to_bytes()
    assert [item.message for item in news if item.message] == [
        "no candidate is better than the pre-trained model, which is kept",
        "no candidate met every goal on every training context; the best seen is kept",
    ]


def test_without_a_context_training_says_what_to_write(tmp_path: Path) -> None:
    fleet = field_fleet()
    full = field_grounds(fleet)
    none = Grounds((), full.agents, full.energy, full.evaluator)
    with pytest.raises(TrainingError, match="the use Training"):
        train(fleet, none, reward_over(full), Run(LocalStorage(tmp_path), "training"))

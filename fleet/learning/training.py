"""First training of SA, with the reward and the thresholds that shaping found.

Each candidate learns from missions of its own over the training contexts and then flies one mission over each of them.
The candidate of the least loss is kept. Candidates of a further period go on from the best so far; nothing is lost:
one that is no better is not kept.

Source: paper, section "Reward Shaping and Training", last paragraph.
"""

from __future__ import annotations

import base64
from dataclasses import asdict, dataclass, field
from typing import Any

from fleet.errors import TrainingError
from fleet.learning.checkpoint import Checkpoint
from fleet.learning.model import SAModel
from fleet.learning.models import blank_model, load_model
from fleet.learning.practice import Grounds, Practice, assess, practise
from fleet.learning.progress import Progress
from fleet.learning.reward import RewardModel
from fleet.learning.run import Run, objective_of, references, shown, total_loss
from fleet.learning.score_tables import Flights
from fleet.learning.workers import Workers
from fleet.randomness import named_seed
from fleet.spec.resources import Fleet

STAGE = "Training"


@dataclass(frozen=True)
class Score:
    """How good a model is.

    Args:
        loss: Sum over the contexts.
        goals_met: Whether every goal was met on every context.
        goals: Value of each goal's metric, by context; None where Eval() gave none.
    """

    loss: float
    goals_met: bool
    goals: tuple[dict[str, float | None], ...]

    @property
    def order(self) -> tuple[bool, float]:
        """Less is better."""
        return not self.goals_met, self.loss


@dataclass(frozen=True, eq=False)
class Problem:
    """What every candidate is given; worker processes get a copy."""

    fleet: Fleet
    grounds: Grounds
    reward: RewardModel
    reference: tuple[float, ...]
    seed: int


@dataclass(eq=False)
class _State:
    """Where training is.

    Args:
        scores: Of the candidates so far.
        start: What the candidates of this period start from; None for a blank model.
        best, best_score: The best candidate so far; None when there is none.
    """

    scores: list[Score] = field(default_factory=list)
    start: SAModel | None = None
    best: SAModel | None = None
    best_score: Score | None = None

    def add(self, model: SAModel, score: Score, epochs: int) -> None:
        """One more candidate; after the last of a period the next period starts from the best."""
        self.scores.append(score)
        if self.best_score is None or score.order < self.best_score.order:
            self.best, self.best_score = model, score
        if len(self.scores) % epochs == 0:
            self.start = self.best


def train(fleet: Fleet, grounds: Grounds, reward: RewardModel, run: Run) -> SAModel:
    """Train SA.

    Args:
        fleet: Goals, SA and training settings.
        grounds: The training contexts.
        reward: What shaping found.
        run: Seed, workers, checkpoints. Killed and started again it goes on, and ends with the same result.
    Raises:
        TrainingError: there is no training context.
        ModelError: the pre-trained model is for another SSV.
        FunctionError: Eval() failed.
    """
    if not grounds.terrains:
        raise TrainingError("no context is for training; give one of `contexts` the use Training")
    run.check(fleet, grounds)
    settings = fleet.training
    total = settings.epochs * settings.periods
    checkpoint = run.checkpoint("candidates", fleet, grounds, reward)
    problem = Problem(fleet, grounds, reward, references(fleet, grounds), run.seed)
    state = _restored(checkpoint) or _State(start=run.pretrained)
    _tell(run, state, total, "going on from a checkpoint" if state.scores else "")
    with Workers(run.workers, problem) as workers:
        while len(state.scores) < total:
            done = len(state.scores)
            count = min(max(run.workers, 1), settings.epochs - done % settings.epochs)
            for model, score in workers.map(learn, [(done + more, state.start) for more in range(count)]):
                state.add(model, score, settings.epochs)
            checkpoint.save(_saved(state))
            _tell(run, state, total)
    return _chosen(run, state, problem, total)


def learn(problem: Problem, item: tuple[int, SAModel | None]) -> tuple[SAModel, Score]:
    """One candidate, (its number, what it starts from); a blank model has centres or weights of its own."""
    number, start = item
    fleet, reward = problem.fleet, problem.reward
    seed = named_seed(problem.seed, f"training/{number}")
    model = start or blank_model(fleet.sa, problem.grounds.features, reward.normaliser, seed)
    practice = Practice.of(fleet.sa, fleet.training.missions, seed)
    model = practise(model, reward, problem.grounds.terrains, practice)
    return model, judge_model(problem, model)


def judge_model(problem: Problem, model: SAModel) -> Score:
    """Loss of one mission over each context; all candidates fly with the same random numbers."""
    fleet, grounds = problem.fleet, problem.grounds
    flights = Flights(exploration=fleet.sa.flight_exploration, seed=named_seed(problem.seed, "training/judge"))
    missions = assess(model, problem.reward, grounds, flights)
    objective = objective_of(fleet, len(grounds.terrains))
    return Score(
        loss=total_loss(objective, missions, problem.reference),
        goals_met=all(objective.met(metrics) for metrics in missions),
        goals=tuple(shown(fleet, metrics) for metrics in missions),
    )


def _chosen(run: Run, state: _State, problem: Problem, total: int) -> SAModel:
    """The best candidate, or the pre-trained model when no candidate is better than that."""
    best, score = state.best, state.best_score
    if best is None or score is None:
        raise TrainingError("training.epochs and training.periods must be at least 1")
    if run.pretrained is not None:
        before = judge_model(problem, run.pretrained)
        if before.order <= score.order:
            best, score = run.pretrained, before
            _tell(run, state, total, "no candidate is better than the pre-trained model, which is kept")
    if not score.goals_met:
        _tell(run, state, total, "no candidate met every goal on every training context; the best seen is kept")
    return best


def _saved(state: _State) -> dict[str, Any]:
    return {
        "scores": [asdict(score) for score in state.scores],
        "best": None if state.best_score is None else state.scores.index(state.best_score),
        "model": _packed(state.best),
        "start": _packed(state.start),
    }


def _restored(checkpoint: Checkpoint) -> _State | None:
    saved = checkpoint.load()
    if saved is None:
        return None
    scores = [Score(score["loss"], score["goals_met"], tuple(score["goals"])) for score in saved["scores"]]
    best = None if saved["best"] is None else scores[saved["best"]]
    return _State(scores, _unpacked(saved["start"]), _unpacked(saved["model"]), best)


def _packed(model: SAModel | None) -> str | None:
    return None if model is None else base64.b64encode(model.to_bytes()).decode()


def _unpacked(text: str | None) -> SAModel | None:
    return None if text is None else load_model(base64.b64decode(text))


def _tell(run: Run, state: _State, total: int, message: str = "") -> None:
    best = state.best_score
    loss, met = (best.loss, best.goals_met) if best else (None, False)
    run.listener(Progress(STAGE, len(state.scores), total, loss, met, message))

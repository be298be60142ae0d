"""Reward shaping: Bayesian optimisation of feature weights and of HA's thresholds over simulated missions.

Each parameter set trains SA for a moment with that reward, flies one mission over each shaping context, and is judged
by the sum of the losses. The best that meets all goals is the result; when none does, the best that was seen is, and
`goals_met` says so.

A further period looks closer around the best so far: its ranges are half as wide as those of the period before, and
start from everything that was seen within them.

Source: paper, section "Reward Shaping and Training", buildReward. Weights start equal and not above one in sum, and
the thresholds at their greatest values.

Where T_u binds depends on the weights: what a group can give grows with their sum. So what is shaped is the share of
that which T_u is, by ratios: a few captured states a group differ by as much as many (`python -m bench.shaping`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

from fleet.errors import TrainingError
from fleet.learning.bayes import Dimension, Optimiser, Point
from fleet.learning.checkpoint import Checkpoint
from fleet.learning.model import SAModel
from fleet.learning.models import blank_model
from fleet.learning.practice import Grounds, Practice, assess, practise
from fleet.learning.progress import Progress
from fleet.learning.reward import Normaliser, RewardModel
from fleet.learning.run import Run, objective_of, references, shown, total_loss
from fleet.learning.score_tables import Flights
from fleet.learning.workers import Workers
from fleet.randomness import named_seed
from fleet.spec.resources import Fleet

STAGE = "Shaping"
LEAST_SHARE = 1.0 / 32.0
"""Of the most that a group can give; with a lower T_u the agents would leave every group at once."""


@dataclass(frozen=True)
class Trial:
    """One parameter set and what became of it.

    Args:
        period: 0 for the first.
        point: Weights by feature, T_u (a share of the most that a group can give, unless it is given), T_v.
        loss: Sum over the contexts.
        goals_met: Whether every goal was met on every context.
        goals: Value of each goal's metric, by context; None where Eval() gave none.
        guide: The loss without its jump at the goals, summed over the contexts: what the optimiser is told.
    """

    period: int
    point: Point
    loss: float
    goals_met: bool
    goals: tuple[Mapping[str, float | None], ...] = ()
    guide: float = math.nan


@dataclass(frozen=True, eq=False)
class Problem:
    """What every trial is given; worker processes get a copy.

    Args:
        fleet, grounds, normaliser: As in `shape`.
        reference: The metric to minimise when every state is visited, for each context.
        seed: Of everything random in a trial.
        pretrained: SA to start from; blank when None.
    """

    fleet: Fleet
    grounds: Grounds
    normaliser: Normaliser
    reference: tuple[float, ...]
    seed: int
    pretrained: SAModel | None


def shape(fleet: Fleet, grounds: Grounds, run: Run, normaliser: Normaliser | None = None) -> RewardModel:
    """Find reward and thresholds.

    Args:
        fleet: Goals, SA, HA and shaping settings.
        grounds: The shaping contexts.
        run: Seed, workers, checkpoints. Killed and started again it goes on, and ends with the same result.
        normaliser: Of the features; by the shaping contexts when left out.
    Raises:
        TrainingError: there is no shaping context, or a given weight is of a feature that Map() does not give.
        ModelError: the pre-trained model is for another SSV.
        FunctionError: Eval() failed.
    """
    if not grounds.terrains:
        raise TrainingError("no context is for shaping; give one of `contexts` the use Shaping")
    run.check(fleet, grounds)
    normaliser = normaliser or Normaliser.over([terrain.ssv for terrain in grounds.terrains])
    dimensions = parameters(fleet, grounds.features)
    settings = fleet.reward_shaping
    epochs = 1 if all(dimension.fixed for dimension in dimensions) else settings.epochs
    total = epochs * settings.periods
    checkpoint = run.checkpoint("trials", fleet, grounds, normaliser)
    trials = _restored(checkpoint)
    _tell(run, trials, total, "going on from a checkpoint" if trials else "")
    reference = references(fleet, grounds)
    problem = Problem(fleet, grounds, normaliser, reference, named_seed(run.seed, "shaping/trial"), run.pretrained)
    with Workers(run.workers, problem) as workers:
        while len(trials) < total:
            period = len(trials) // epochs
            count = min(settings.batch, epochs * (period + 1) - len(trials))
            points = optimiser_of(dimensions, fleet, trials, period, run.seed).ask(count)
            trials += workers.map(evaluate, [(period, point) for point in points])
            checkpoint.save({"trials": [asdict(trial) for trial in trials]})
            _tell(run, trials, total)
    best = best_of(trials)
    if not best.goals_met:
        _tell(run, trials, total, "no parameter set met every goal on every shaping context; the best seen is kept")
    reward = reward_of(fleet, grounds.features, normaliser, best)
    return reward.model_copy(update={"evaluations": len(trials), "successes": sum(t.goals_met for t in trials)})


def given_reward(fleet: Fleet, features: Sequence[str], normaliser: Normaliser) -> RewardModel:
    """The reward of a FleetSpec that gives every weight and threshold, and so has nothing to shape.

    Raises:
        TrainingError: something is left to shape, but no context is for that.
    """
    dimensions = parameters(fleet, features)
    if not all(dimension.fixed for dimension in dimensions):
        raise TrainingError("no context is for shaping; give one of `contexts` the use Shaping")
    point = tuple(dimension.low for dimension in dimensions)
    return reward_of(fleet, features, normaliser, Trial(0, point, loss=0.0, goals_met=False))


def parameters(fleet: Fleet, features: Sequence[str]) -> tuple[Dimension, ...]:
    """Weight of each feature, T_u and T_v, with their ranges; what the FleetSpec gives is fixed.

    T_u is a share of the most that a group can give, unless it is given.

    Raises:
        TrainingError: a given weight is of a feature that Map() does not give.
    """
    given = fleet.reward_shaping.weights
    unknown = sorted(set(given) - set(features))
    if unknown:
        raise TrainingError(
            f"rewardShaping.weights names {', '.join(unknown)}; write a feature that Map() gives: {', '.join(features)}"
        )
    weights = [Dimension(f"weight of {name}", given.get(name, 0.0), given.get(name, 1.0)) for name in features]
    utility, visited = fleet.ha.utility_threshold, fleet.ha.visited_threshold
    groups = fleet.state_space.groups
    last = groups.rows * groups.columns - 1
    shaped = Dimension("T_u as a share", LEAST_SHARE, 1.0, logarithmic=True)
    return (
        *weights,
        shaped if utility is None else Dimension("T_u", utility, utility),
        Dimension("T_v", visited or 0, last if visited is None else visited, integer=True),
    )


def best_of(trials: Sequence[Trial]) -> Trial:
    """The first of the least loss, among those that meet every goal if any does."""
    return min(trials, key=lambda trial: (not trial.goals_met, trial.loss))


def reward_of(fleet: Fleet, features: Sequence[str], normaliser: Normaliser, trial: Trial) -> RewardModel:
    """The reward model of a trial's parameters."""
    *weights, utility, visited = trial.point
    if fleet.ha.utility_threshold is None:
        groups = fleet.state_space.groups
        utility *= sum(weights) * groups.rows * groups.columns  # features are at most 1
    return RewardModel(
        features=tuple(features),
        weights=tuple(weights),
        normaliser=normaliser,
        utility_threshold=utility,
        visited_threshold=int(visited),
        loss=trial.loss,
        goals_met=trial.goals_met,
    )


def optimiser_of(
    dimensions: Sequence[Dimension], fleet: Fleet, trials: Sequence[Trial], period: int, seed: int
) -> Optimiser:
    """The optimiser of a period, told all that was seen within its ranges.

    Args:
        dimensions: As `parameters` gives them.
        trials: All so far, also those of earlier periods.
    """
    settings = fleet.reward_shaping
    ranges, first = tuple(dimensions), [_start(dimensions)]
    spread = min(2 * len(dimensions), max(settings.epochs // 3, 1))
    earlier = [trial for trial in trials if trial.period < period]
    if earlier:
        centre = best_of(earlier).point
        ranges = tuple(_around(whole, value, period) for whole, value in zip(dimensions, centre, strict=True))
        first, spread = [], min(settings.batch, spread)
    optimiser = Optimiser(ranges, named_seed(seed, f"shaping/{period}"), spread, first)
    known = [t for t in earlier if all(d.holds(value) for d, value in zip(ranges, t.point, strict=True))]
    optimiser.know([trial.point for trial in known], [trial.guide for trial in known])
    tried = [trial for trial in trials if trial.period == period]
    optimiser.tell([trial.point for trial in tried], [trial.guide for trial in tried])
    return optimiser


def _start(dimensions: Sequence[Dimension]) -> Point:
    """Equal weights that are 1 in sum, and the greatest thresholds: as thorough as HA can be."""
    weights = len(dimensions) - 2
    return (
        *(min(max(1.0 / weights, dimension.low), dimension.high) for dimension in dimensions[:-2]),
        *(dimension.high for dimension in dimensions[-2:]),
    )


def _around(dimension: Dimension, centre: float, period: int) -> Dimension:
    """A range around a value, half as wide in each period, and within the whole range."""
    share = 1.0 / 2 ** (period + 1)
    reach = (dimension.high - dimension.low) * share
    low, high = centre - reach, centre + reach
    if dimension.integer:
        low, high = centre - math.ceil(reach), centre + math.ceil(reach)
    elif dimension.logarithmic:
        factor = (dimension.high / dimension.low) ** share
        low, high = centre / factor, centre * factor
    return replace(dimension, low=max(dimension.low, low), high=min(dimension.high, high))


def evaluate(problem: Problem, item: tuple[int, Point]) -> Trial:
    """Try a parameter set, (its period, the values).

    All sets learn and fly with the same random numbers, so that what differs is the set.
    """
    period, point = item
    fleet, grounds = problem.fleet, problem.grounds
    reward = reward_of(fleet, grounds.features, problem.normaliser, Trial(period, point, 0.0, False))
    start = problem.pretrained or blank_model(fleet.sa, grounds.features, problem.normaliser, problem.seed)
    practice = Practice.of(fleet.sa, fleet.reward_shaping.missions, problem.seed)
    model = practise(start, reward, grounds.terrains, practice)
    missions = assess(model, reward, grounds, Flights(exploration=fleet.sa.flight_exploration, seed=problem.seed))
    objective = objective_of(fleet, len(grounds.terrains))
    return Trial(
        period=period,
        point=point,
        loss=total_loss(objective, missions, problem.reference),
        goals_met=all(objective.met(metrics) for metrics in missions),
        goals=tuple(shown(fleet, metrics) for metrics in missions),
        guide=sum(objective.guide(each, scale) for each, scale in zip(missions, problem.reference, strict=True)),
    )


def _restored(checkpoint: Checkpoint) -> list[Trial]:
    state = checkpoint.load() or {"trials": []}
    return [
        Trial(t["period"], tuple(t["point"]), t["loss"], t["goals_met"], tuple(t["goals"]), t["guide"])
        for t in state["trials"]
    ]


def _tell(run: Run, trials: Sequence[Trial], total: int, message: str = "") -> None:
    best = best_of(trials) if trials else None
    loss, met = (best.loss, best.goals_met) if best else (None, False)
    run.listener(Progress(STAGE, len(trials), total, loss, met, message))

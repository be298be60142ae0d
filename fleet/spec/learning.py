"""SA, HA, reward shaping and training settings of the FleetSpec."""

from __future__ import annotations

from enum import StrEnum

from pydantic import Field

from fleet.spec.base import Fraction, MetricName, Model, NonNegative, Positive, Uri

BELIEVED = ("doubt", "doubt_around", "novelty")
"""What a Planner weighs of a state that it might capture."""


class SAKind(StrEnum):
    """State-to-action models that the platform has."""

    Q_LEARNING = "QLearning"
    DQN = "DQN"
    DDPG = "DDPG"
    PLANNER = "Planner"


class SASpec(Model):
    """State-to-action model: which action in a state."""

    kind: SAKind = Field(
        default=SAKind.Q_LEARNING,
        description="QLearning, DQN and DDPG choose moves within state groups (the latter two need the extra `deep`). "
        "Planner flies anywhere over the field, where captures make its map better; it needs a goal for accuracy.",
    )
    feature: MetricName | None = Field(
        default=None,
        description="Planner: the feature of the SSV that is mapped. When left out, the one that the context knows the "
        "truth of, or the first.",
    )
    pretrained: Uri | None = Field(
        default=None, description="Address of a saved model to start from; blank when left out."
    )
    learning_rate: Fraction = Field(default=0.1, description="Alpha of the Bellman update.")
    discount: Fraction = Field(default=0.9, description="Gamma of the Bellman update.")
    exploration: Fraction = Field(default=0.2, description="Share of random moves while training.")
    flight_exploration: Fraction = Field(default=0.0, description="Share of random moves in a flown mission.")


class HASpec(Model):
    """History-to-action model: when to leave a state group, and with Planner when to land.

    Values given here are fixed; others are shaped.
    """

    utility_threshold: NonNegative | None = Field(
        default=None, description="T_u; found by reward shaping when left out."
    )
    visited_threshold: int | None = Field(
        default=None, description="T_v; found by reward shaping when left out.", ge=0, le=4096
    )
    confidence: Fraction = Field(
        default=0.9,
        description="Planner: share of the simulated missions over the shaping contexts that must have met every goal "
        "when they end.",
    )
    caution: NonNegative | None = Field(
        default=None,
        description="Planner: how much the accuracy that the agents expect of their map must be above the goal after "
        "one prediction; it falls with the square root of their number. When left out, found on the shaping contexts, "
        "or what is usual for the goal.",
    )


class RewardShaping(Model):
    """Bayesian optimisation of feature weights and HA thresholds over simulated missions."""

    epochs: int = Field(
        default=48, description="Simulated parameter sets per period (numEpochs of the paper).", ge=1, le=10000
    )
    periods: int = Field(
        default=1, description="How often shaping is repeated, each time from the last result.", ge=1, le=100
    )
    batch: int = Field(default=4, description="Parameter sets that are simulated side by side.", ge=1, le=64)
    missions: int = Field(
        default=256, description="Simulated missions that train SA for one parameter set.", ge=1, le=100000
    )
    minimise: MetricName = Field(
        default="uav_energy_j", description="Metric that decides among parameter sets that meet every goal."
    )
    margin: NonNegative = Field(
        default=0.02,
        description="How far each goal must be over-fulfilled on the shaping contexts, as a share of the goal.",
    )
    weights: dict[str, Fraction] = Field(
        default={}, description="Reward weights by feature that are given, not shaped.", max_length=128
    )


class Training(Model):
    """First training of SA, after shaping."""

    epochs: int = Field(default=4, description="Candidate models per period; the best is kept.", ge=1, le=1000)
    periods: int = Field(default=1, description="Retraining periods, each from the best model so far.", ge=1, le=100)
    missions: int = Field(default=1024, description="Simulated missions per candidate.", ge=1, le=1000000)


class Retraining(Model):
    """Retraining after a mission, by aggregators."""

    epochs: int = Field(default=8, description="Passes over the subset's records.", ge=1, le=1000)
    learning_rate: Fraction = Field(default=0.05, description="Alpha of the update from records.")
    every: int = Field(default=1, description="Retrain after every so many missions.", ge=1, le=10000)


class WeightLearner(StrEnum):
    """How the weights that an agent gives the models are found."""

    EXPECTED_IMPROVEMENT = "ExpectedImprovement"
    UNIFORM = "Uniform"
    MULTIPLICATIVE_WEIGHTS = "MultiplicativeWeights"
    BEST_BY_REPLAY = "BestByReplay"


class OnlineLearning(Model):
    """Learning between missions."""

    retraining: Retraining = Field(default=Retraining(), description="How aggregators retrain.")
    weights: WeightLearner = Field(
        default=WeightLearner.MULTIPLICATIVE_WEIGHTS,
        description="How each agent's weights over the models are found; the paper's is ExpectedImprovement.",
    )
    replays: int = Field(
        default=16,
        description="Replays of the mission's own records as cheaper observations of the weights; 0 for none. "
        "MultiplicativeWeights and BestByReplay replay each model once, however many there are, and without replays "
        "every agent keeps its first model.",
        ge=0,
        le=1024,
    )
    memory: bool = Field(
        default=True,
        description="Planner: a mission expects of each cell what the missions before it found there, and Eval() is "
        "told (`environment.expected`). Where shaping finds that Eval() makes no use of it, nothing is expected.",
    )
    replay_noise: Positive = Field(
        default=2.0, description="Standard deviation of a replay's noise, as a multiple of a mission's."
    )

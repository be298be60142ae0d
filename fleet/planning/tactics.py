"""How a swarm scouts: what it wants to capture, and how it looks for paths there. Loads nothing heavy."""

from __future__ import annotations

from pydantic import Field

from fleet.spec.base import Model, NonNegative


class InterestWeights(Model):
    """Weights of the features of a cell that might be captured."""

    doubt: NonNegative = Field(default=1.0, description="Probability that its believed class is wrong.")
    doubt_around: NonNegative = Field(
        default=1.0,
        description="The same of the cells around it, which the capture would tell of; the nearer the more.",
    )
    novelty: NonNegative = Field(
        default=0.3,
        description="1 - exp(-d / 3), with d the distance to the nearest captured cell, in cells of the mean size.",
    )


class Search(Model):
    """How far and how wide is looked for paths."""

    horizon: int = Field(default=16, description="Longest path, in moves.", ge=1, le=256)
    width: int = Field(default=48, description="Paths of each length that are followed further.", ge=1, le=4096)


class Tactics(Model):
    """How a swarm scouts."""

    weights: InterestWeights = Field(default=InterestWeights(), description="What makes a capture interesting.")
    search: Search = Field(default=Search(), description="How far and how wide is looked for paths.")
    moves: int = Field(default=3, description="Moves of a path that are flown before the next look.", ge=1)
    thrift: NonNegative = Field(
        default=0.7,
        description="What a path must bring for its energy, as a share of what the better half of the cells would.",
    )

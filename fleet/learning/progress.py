"""How far shaping or training is, for whoever shows it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """One piece of news.

    Args:
        stage: "Shaping" or "Training".
        done, total: Parameter sets or candidate models that are evaluated, and that there will be.
        best_loss: Loss of the best so far; None before the first.
        goals_met: Whether the best so far meets every goal.
        message: A sentence for the user; mostly empty.
    """

    stage: str
    done: int
    total: int
    best_loss: float | None = None
    goals_met: bool = False
    message: str = ""


Listener = Callable[[Progress], None]
"""Told about progress, in the process that shapes or trains."""


def nobody(_: Progress) -> None:
    """A listener that does nothing."""

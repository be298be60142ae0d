"""What a plan is: a way to fly a field with several agents."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from bench.scouting.fields import Field
from bench.scouting.flight import Flights


class Plan(Protocol):
    """A rival, or a policy of the platform.

    A plan looks at `field.truth` only in cells that it has captured (the oracle says that it does otherwise).
    """

    @property
    def name(self) -> str:
        """For tables; unique."""

    def budgets(self, field: Field) -> Sequence[float]:
        """Budgets to fly this field with, ascending, in (0, 1]: each is one mission, and of them the least that meets
        a goal counts. Empty for a plan that flies on to the end without one, and is judged all along its way."""

    def fly(self, field: Field, agents: int, seed: int, budget: float | None) -> Flights:
        """Fly a mission.

        Args:
            agents: How many fly, all at the same time.
            seed: Fixes all that is random.
            budget: About which share of the cells is visited on purpose; None for a plan without budgets.
        Returns:
            One flight for each agent.
        """

"""HA: when an agent leaves a state group.

Source: paper, section "State-To-Action and History-To-Action Models". The paper prints 0 for "above a threshold" and
says that 0 means to continue; here above a threshold means to move on, which is what its text is about.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ThresholdHA:
    """The group is left when U > T_u or V > T_v.

    Args:
        utility_threshold: T_u; U is the sum of the rewards of all transitions in the group.
        visited_threshold: T_v; V is the number of states of the group that were captured.
    """

    utility_threshold: float
    visited_threshold: int

    def moves_on(self, utility: float, visited: int) -> bool:
        """True when the group is left."""
        return self.is_useful_enough(utility) or self.is_seen_enough(visited)

    def is_useful_enough(self, utility: float) -> bool:
        """U > T_u."""
        return utility > self.utility_threshold

    def is_seen_enough(self, visited: int) -> bool:
        """V > T_v."""
        return visited > self.visited_threshold

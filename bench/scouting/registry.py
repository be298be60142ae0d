"""Every plan that is compared, by name."""

from __future__ import annotations

from bench.scouting.ours import ours
from bench.scouting.plans import Plan
from bench.scouting.rivals.greedy import gaussian_process, greedy_oracle
from bench.scouting.rivals.groups import ClassicRL, Groups
from bench.scouting.rivals.lines import Lawnmower, Transects
from bench.scouting.rivals.oracle import OracleTour
from bench.scouting.rivals.tours import LatticeTour, RandomTour


def plans() -> dict[str, Plan]:
    """All plans in the order of the tables."""
    every: tuple[Plan, ...] = (
        RandomTour(),
        LatticeTour(),
        RandomTour(whole_path=True),
        LatticeTour(whole_path=True),
        Transects(along_rows=True),
        Transects(along_rows=False),
        Lawnmower(),
        gaussian_process(),
        ClassicRL(),
        Groups(),
        Groups(whole_path=True),
        OracleTour(),
        greedy_oracle(),
        *ours(),
    )
    return {plan.name: plan for plan in every}

"""What a learning role spends: processor time of this process and its workers, and the energy for it."""

from __future__ import annotations

import resource
import time

from fleet.energy.accounting import EnergyModel
from fleet.missions.documents import Expense


class Meter:
    """Measures from its making; worker processes count once they have ended.

    Args:
        energy: Gives the energy of an edge machine for processor time.
    """

    def __init__(self, energy: EnergyModel) -> None:
        self._energy = energy
        self._started_s, self._started_cpu_s = time.monotonic(), _cpu_s()

    def read(self) -> Expense:
        """What was spent so far."""
        cpu_s = _cpu_s() - self._started_cpu_s
        wall_s = time.monotonic() - self._started_s
        return Expense(cpu_s=cpu_s, wall_s=wall_s, energy_j=self._energy.retraining_energy_j(cpu_s))


def _cpu_s() -> float:
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)

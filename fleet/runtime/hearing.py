"""What an agent hears of the others in flight: their logs in storage, up to a moment of mission time.

Missions need not run by the clock of the wall, and agents do not compute equally fast. So an agent that wants to know
what the others had done at some mission time waits until their logs say so: each record tells when the next one comes
at the earliest. The agent whose time is least never waits, so no two wait for each other; of equal times the first
agent is before the second. What agents hear is therefore the same however fast each of them is, unless one is silent
for so long that the others go on without it.

Source: Chandy, Misra 1979, Distributed Simulation, IEEE TSE SE-5 (conservative synchronisation).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from fleet.clock import Clock
from fleet.energy.accounting import EnergyModel
from fleet.errors import MissionError, ObjectNotFound
from fleet.missions.flight import LAND
from fleet.missions.layout import MOVES
from fleet.missions.records import Record, records_in
from fleet.runtime.settings import Settings

_log = logging.getLogger(__name__)
PATIENCE_S = 300.0
"""How long an agent waits for one that is silent: longer than the storage is tried again for (120 s), and than a pod
takes that is started again for the fourth time (150 s)."""
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.005, 0.2
Told = tuple[tuple[Record, ...], ...]
"""New records of each agent, in the fleet's order; none of the agent's own."""


def next_arrival_s(record: Record, energy: EnergyModel) -> float:
    """When the state after a record is reached: mission time in s, infinite after the landing."""
    if record.move == LAND:
        return math.inf
    time_s = record.time_s
    if record.captured:
        time_s += energy.capture().time_s
    if record.legal:
        time_s += energy.decision().time_s
    return time_s + energy.move(MOVES[record.move]).time_s


@dataclass(eq=False)
class _Other:
    """Another agent.

    Args:
        records: Its log, as far as it was read.
        told: How many records were handed over.
        size: Bytes of its log that were read, up to a line's end.
        is_gone: Whether its part of the mission is over without a landing in the log.
        is_silent: Whether it was waited for in vain, and has said nothing since.
    """

    name: str
    records: list[Record] = field(default_factory=list)
    told: int = 0
    size: int = 0
    is_gone: bool = False
    is_silent: bool = False


class Hearing:
    """Reads the other agents' logs of a mission.

    Args:
        settings: Whose agent, which mission.
        clock: For waiting.
        patience_s: How long a silent agent is waited for.
    """

    def __init__(self, settings: Settings, clock: Clock, patience_s: float = PATIENCE_S) -> None:
        self._storage, self._clock, self._patience_s = settings.storage, clock, patience_s
        self._energy, self._me = settings.energy, settings.agent_index
        paths, number = settings.paths, settings.mission
        self._others = [_Other(agent.name) for agent in settings.fleet.agents.resolved]
        self._logs = [paths.log(number, other.name) for other in self._others]
        self._landings = [paths.landing(number, other.name) for other in self._others]

    def until(self, time_s: float) -> Told:
        """What the others did before a moment, as far as it is new; waits until that is known."""
        for index in self._all_others():
            self._wait(index, time_s)
        return self._tell(lambda index, record: (record.time_s, index) < (time_s, self._me))

    def exactly(self, counts: Sequence[int]) -> Told:
        """So many records of each agent, as far as they are new.

        Raises:
            MissionError: a log is shorter.
        """
        for index in self._all_others():
            self._wait_for_records(index, counts[index])
        return self._tell(lambda index, record: record.step < counts[index])

    def is_overdue(self, index: int, time_s: float) -> bool:
        """Whether an agent should have said more by a moment than was told of it: it has failed, or is silent."""
        other = self._others[index]
        return (self._next_s(other.records[: other.told]), index) < (time_s, self._me)

    @property
    def counts(self) -> tuple[int, ...]:
        """How many records of each agent were handed over so far."""
        return tuple(other.told for other in self._others)

    def _all_others(self) -> list[int]:
        return [index for index in range(len(self._others)) if index != self._me]

    def _tell(self, counts: Callable[[int, Record], bool]) -> Told:
        told: list[tuple[Record, ...]] = []
        for index, other in enumerate(self._others):
            fresh = []
            while index != self._me and other.told < len(other.records) and counts(index, other.records[other.told]):
                fresh.append(other.records[other.told])
                other.told += 1
            told.append(tuple(fresh))
        return tuple(told)

    def _wait(self, index: int, time_s: float) -> None:
        """Until it is known what another agent did before a moment, or that it is silent or gone."""
        other, pause_s, until = self._others[index], _FIRST_WAIT_S, self._clock.now() + self._patience_s
        while not self._is_known(index, time_s):
            if self._read(index):
                other.is_silent = False
                continue
            if self._is_over(index) or other.is_silent:
                return
            if self._clock.now() >= until:
                other.is_silent = True
                _log.warning("%s says nothing for %.0f s; flying on without it", other.name, self._patience_s)
                return
            self._clock.sleep(pause_s)
            pause_s = min(2.0 * pause_s, _LONGEST_WAIT_S)

    def _wait_for_records(self, index: int, count: int) -> None:
        """Until a log has so many records: one that was cut off by a crash is written on by its agent."""
        other, pause_s, until = self._others[index], _FIRST_WAIT_S, self._clock.now() + self._patience_s
        while len(other.records) < count:
            if self._read(index):
                continue
            if self._is_over(index) or self._clock.now() >= until:
                raise MissionError(
                    f"a plan was made with {count} records of {other.name}, whose log has {len(other.records)}; "
                    "the log is damaged, or of another run"
                )
            self._clock.sleep(pause_s)
            pause_s = min(2.0 * pause_s, _LONGEST_WAIT_S)

    def _is_known(self, index: int, time_s: float) -> bool:
        return (self._next_s(self._others[index].records), index) > (time_s, self._me)

    def _next_s(self, records: Sequence[Record]) -> float:
        """When the record after these comes."""
        return next_arrival_s(records[-1], self._energy) if records else self._energy.take_off().time_s

    def _is_over(self, index: int) -> bool:
        """Whether an agent's part of the mission is over; its log is read once more, as it ended before that."""
        other = self._others[index]
        if not other.is_gone and self._storage.exists(self._landings[index]):
            self._read(index, whole=True)
            other.is_gone = not other.records or other.records[-1].move != LAND
        return other.is_gone

    def _read(self, index: int, whole: bool = False) -> bool:
        """Read what is new in a log; whether there was anything.

        Args:
            whole: Whether the log is over, so that a last line without an end counts too.
        """
        other = self._others[index]
        try:
            data = self._storage.read(self._logs[index])
        except ObjectNotFound:
            return False
        end = len(data) if whole else data.rfind(b"\n") + 1
        if end <= other.size:
            return False
        before = len(other.records)
        for record in records_in(data[other.size : end].splitlines()):
            if record.step == len(other.records):  # a step that was torn is written again, after the torn line
                other.records.append(record)
        other.size = end
        return len(other.records) > before

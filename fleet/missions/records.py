"""The log of one agent's mission: one line a visited state, durable before the next move.

The log is the agent's memory. A workflow that was killed reads it and goes on; readers drop a torn last line and
lines that were written twice.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass

_OF_PLANS = {"plan": (), "heard": (), "claimed": None, "predictions": 0}
"""Left out of a line when they are so, as they are in flights through state groups."""
_TUPLES = ("ssv", "plan", "heard")


@dataclass(frozen=True)
class Record:
    """One visited state and the move that left it.

    Args:
        step: 0 in the take-off cell.
        cell: The state.
        row, column: The same in rows and columns of the context.
        captured: Whether the state was sensed and mapped in this visit.
        ssv: The state-space vector; empty when not captured.
        legal: Bit i is set when SA could choose MOVES[i]; 0 when SA was not asked.
        move: Index into MOVES, or -1 for landing.
        action: The name of the move, or "Land".
        time_s: Mission time on arrival in the state, in s.
        uav_energy_j: Energy of the aircraft spent up to and including the capture here.
        plan: Moves that are to follow this one, where SA plans.
        heard: How many records of each agent, in the fleet's order, a plan was made with; empty where none was made.
        claimed: The accuracy that the agent then expected of its map; None where it planned nothing.
        predictions: How many predictions this was calibrated on.
    """

    step: int
    cell: int
    row: int
    column: int
    captured: bool
    ssv: tuple[float, ...]
    legal: int
    move: int
    action: str
    time_s: float
    uav_energy_j: float
    plan: tuple[int, ...] = ()
    heard: tuple[int, ...] = ()
    claimed: float | None = None
    predictions: int = 0

    def to_line(self) -> bytes:
        """The record as a line of JSON, with a line end on both sides so that a torn line before it stays alone."""
        fields = asdict(self)
        for name, empty in _OF_PLANS.items():
            if fields[name] == empty:
                del fields[name]
        return b"\n" + json.dumps(fields, separators=(",", ":")).encode() + b"\n"


def read_log(data: bytes) -> tuple[Record, ...]:
    """The records of a log in the order of their steps, each step once, up to the first step that is missing."""
    found = {record.step: record for record in records_in(data.splitlines())}
    records: list[Record] = []
    while len(records) in found:
        records.append(found[len(records)])
    return tuple(records)


def records_after_gap(data: bytes) -> int:
    """How many steps of a log follow one that is missing; 0 unless the log was damaged after it was written."""
    steps = {record.step for record in records_in(data.splitlines())}
    return len(steps) - len(read_log(data))


def records_in(lines: Iterable[bytes]) -> Iterator[Record]:
    """The records of some lines of a log, as they come; torn lines are left out."""
    for line in lines:
        try:
            fields = json.loads(line)
            yield Record(**{**fields, **{name: tuple(fields[name]) for name in _TUPLES if name in fields}})
        except (ValueError, TypeError, KeyError):  # a torn line: its writer died, and wrote the step again
            continue

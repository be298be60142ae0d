"""How one agent decides, state by state, and from what each decision was made.

The AS workflow flies with a mind; `fleet explain` lives a log again with one. So what is explained is what was decided.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Environment
from fleet.errors import MissionError
from fleet.missions.flight import LAND, Decision
from fleet.missions.layout import MOVES
from fleet.missions.records import Record
from fleet.planning.stop import Claim
from fleet.runtime.settings import Settings
from fleet.spec.learning import SAKind


@dataclass(frozen=True, eq=False, kw_only=True)
class Thought:
    """One decision.

    Args:
        decision: What the agent does.
        plan: Moves that are to follow this one.
        heard: How many records of each agent the plan was made with; empty where none was made.
        claim: What the agent claimed of its map; None where it did not.
    """

    decision: Decision
    plan: tuple[int, ...] = ()
    heard: tuple[int, ...] = ()
    claim: Claim | None = None


class Mind(Protocol):
    """Decides for one agent."""

    @property
    def features(self) -> tuple[str, ...]:
        """Features of the SSV that it expects."""

    @property
    def memory(self) -> dict[int, NDArray[np.float64]]:
        """SSVs that the agent captured, by cell."""

    @property
    def cell(self) -> int:
        """Where the agent is."""

    @property
    def landed(self) -> bool:
        """Whether the flight is over."""

    @property
    def groups(self) -> tuple[int, int]:
        """Parts of the field that are the agent's, and those of them that are behind it."""

    def wants_capture(self) -> bool:
        """Whether the current state is to be sensed and mapped."""

    def visit(
        self, ssv: NDArray[np.float64] | None, time_s: float, finished: Callable[[], bool] | None = None
    ) -> Thought:
        """Take in the current state's SSV, decide, and move on.

        Args:
            ssv: State-space vector, float64 [features]; None when the state is not captured.
            time_s: Mission time on arrival in the state.
            finished: Eval() of what was captured so far; asked as in `Flight.arrive`, when the FleetSpec wants it.
        """

    def relive(self, record: Record) -> Thought:
        """Live a state of the log again.

        Raises:
            MissionError: the log is of another flight than these settings give.
        """


def open_mind(settings: Settings, environment: Environment) -> Mind:
    """The mind of an agent of a mission.

    Args:
        settings: Whose agent, which mission.
        environment: Where the mission flies.
    Raises:
        ModelError: a model cannot be loaded.
        MissionError: the mission has no weights for this agent.
    """
    if settings.fleet.sa.kind is SAKind.PLANNER:
        from fleet.runtime.scout_mind import ScoutMind  # noqa: PLC0415 - loads scipy and numba

        return ScoutMind(settings, environment)
    from fleet.runtime.group_mind import GroupMind  # noqa: PLC0415 - each role loads the mind that it needs

    return GroupMind(settings, environment)


def action_of(decision: Decision) -> str:
    """The name of a move, or "Land"."""
    return "Land" if decision.move == LAND else str(MOVES[decision.move])


def check_relived(record: Record, decision: Decision) -> None:
    """Whether a state that was lived again ended as the log says.

    Raises:
        MissionError: it did not.
    """
    action = action_of(decision)
    if (decision.cell, action) != (record.cell, record.action):
        raise MissionError(
            f"step {record.step} of the log says {record.action} in cell {record.cell}, but this FleetSpec, "
            f"seed and models give {action} in cell {decision.cell}; start a new run"
        )


def recorded_ssv(record: Record, captures: bool, features: Sequence[str]) -> NDArray[np.float64] | None:
    """What was captured in a state of the log.

    Args:
        record: The state.
        captures: Whether the flight captures here.
        features: Of the SSV.
    Raises:
        MissionError: the log has something else.
    """
    ssv = np.array(record.ssv, dtype=np.float64) if record.captured else None
    if record.captured != captures or (ssv is not None and len(ssv) != len(features)):
        said = f"an SSV of {len(record.ssv)} features" if record.captured else "no SSV"
        wanted = len(features) if captures else "no"
        raise MissionError(
            f"step {record.step} of the log has {said}, but here the flight captures {wanted} features; "
            "the log is damaged, or of another run"
        )
    return ssv

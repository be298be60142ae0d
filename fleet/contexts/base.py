"""What every kind of context has: states, and what a sensor would have observed in each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.grid import Grid


class ContextKind(StrEnum):
    """Kinds of execution contexts (paper, table 1). Autonomy cubes are built; the others have their place."""

    AUTONOMY_CUBE = "AutonomyCube"
    VIDEO_STREAM = "VideoStream"
    POINT_CLOUD = "PointCloud"


@dataclass(frozen=True)
class Media:
    """Sensed data as bytes of a media type: a picture, a frame, a scan."""

    type: str
    data: bytes


@dataclass(frozen=True)
class Observation:
    """D_j of the paper: what the sensors of one agent observed in one state.

    Args:
        state: The state's number: the cell on a grid.
        label: The state for people and logs: "row 3, column 7".
        media: Pictures, frames or scans; may be empty.
        attributes: Numbers that the sensor gives beside them: lat, lon, exposure_s.
        time_s: When it was observed, in s since the start of the mission.
    """

    state: int
    label: str
    media: tuple[Media, ...] = ()
    attributes: Mapping[str, float] = field(default_factory=dict)
    time_s: float = 0.0


@dataclass(frozen=True, eq=False)
class Expectation:
    """What is expected of each cell before anything is captured; both are finite where there is data.

    Args:
        values: Expected value, float64 [rows, columns].
        deviation: Standard deviation, likewise; 0 where it was measured.
    """

    values: NDArray[np.float64]
    deviation: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Environment:
    """What is known of the place where a mission flies, without flying: its grid and, in replay, the truth.

    Args:
        name: Name of the context.
        digest: Hash of the context's content.
        grid: States and which of them have data.
        truth_name: The quantity that missions map (`exg`, `yield`); "" when nothing is known of it.
        truth: That quantity in every cell, float64 [rows, columns], NaN without data; None outside of replay.
        expected: What earlier missions over the place make expect of the quantity that is mapped; None for nothing.
    """

    name: str
    digest: str
    grid: Grid
    truth_name: str = ""
    truth: NDArray[np.float64] | None = None
    expected: Expectation | None = None


class Context(Protocol):
    """A completely explored place: an observation for every state that has data."""

    @property
    def kind(self) -> ContextKind:
        """Kind of the context."""

    @property
    def environment(self) -> Environment:
        """Grid, name, digest and truth."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user of the context should be told, such as that its pictures were not taken but drawn."""

    def observe(self, state: int) -> Observation:
        """What a sensor would observe in a state.

        Raises:
            ContextError: the state has no data.
        """

"""What happens on the machine, for whoever shows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fleet_operator.resources import names
from fleet_operator.resources.roles import Role


@dataclass(frozen=True)
class Subject:
    """Whom an event is about, from the labels of the Job.

    Args:
        job: Name of the Job.
        mission: 0 before the first mission.
    """

    job: str
    role: str
    mission: int = 0
    agent: str = ""
    subset: str = ""

    @staticmethod
    def of(job: str, labels: Mapping[str, str]) -> Subject:
        """Read the labels of a Job's pods."""
        return Subject(
            job,
            labels.get(names.ROLE_LABEL, ""),
            int(labels.get(names.MISSION_LABEL, "0")),
            labels.get(names.AGENT_LABEL, ""),
            labels.get(names.SUBSET_LABEL, ""),
        )

    def __str__(self) -> str:
        match self.role:
            case Role.SENSOR | Role.WORKFLOW:
                return f"{self.role.lower()} of {self.agent}"
            case Role.AGGREGATOR:
                return f"aggregator of {self.subset}"
            case Role.TRAINER:
                return "trainer"
            case _:
                return self.job


@dataclass(frozen=True)
class PodStarted:
    """The containers of a Job were started, for the first time or again."""

    subject: Subject
    attempt: int


@dataclass(frozen=True)
class ContainerDied:
    """A container ended that should not have, and is started again.

    Args:
        reason: What happened, in words, with the end of its log.
    """

    subject: Subject
    container: str
    reason: str
    attempt: int


@dataclass(frozen=True)
class JobSucceeded:
    """A Job's program has done its work."""

    subject: Subject
    seconds: float


@dataclass(frozen=True)
class JobFailed:
    """A Job is not tried again."""

    subject: Subject
    reason: str


Event = PodStarted | ContainerDied | JobSucceeded | JobFailed

"""Every error that the library raises on purpose, in one tree.

FleetError
├── SpecError             a FleetSpec (or Mission, EdgeNode) is not valid; carries every problem at once
├── ContextError          a context cannot be read, or is not a good one
├── FunctionError         Map() or Eval() raised, hung, or answered something that is not an SSV or an evaluation
├── ModelError            an SA model cannot be loaded, or does not fit the SSV or the actions
├── StorageError
│   ├── ObjectNotFound
│   ├── StorageFull
│   ├── StorageReadOnly
│   └── StorageUnavailable   passing: trying again may help
├── DriverError           the action driver refused, or cannot be reached
├── TrainingError         reward shaping or training cannot go on
└── MissionError          a mission cannot be planned, flown or evaluated
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class ExitCode(IntEnum):
    """What a program of the platform says when it ends (sysexits where it has a fitting one)."""

    OK = 0
    GOALS_MISSED = 1
    USAGE = 2
    PERMANENT = 65
    """The same input will fail again: a supervisor must not restart the program."""
    TRANSIENT = 75
    INTERRUPTED = 130


class FleetError(Exception):
    """Root of the tree; its text is meant for the user, and says what to change."""

    exit_code = ExitCode.TRANSIENT


@dataclass(frozen=True, order=True)
class Problem:
    """One thing that is wrong in a document: where, what, and what to write instead.

    Args:
        line: Line of the file, from 1; 0 when the document is not from a file.
    """

    path: str
    message: str
    hint: str = ""
    line: int = 0

    def __str__(self) -> str:
        where = f"line {self.line}: " if self.line else ""
        text = f"{where}{self.path}: {self.message}" if self.path else f"{where}{self.message}"
        return f"{text}; {self.hint}" if self.hint else text


class SpecError(FleetError):
    """A document is not valid; `problems` has everything that is wrong with it."""

    exit_code = ExitCode.USAGE

    def __init__(self, problems: list[Problem], source: str = "") -> None:
        self.problems = tuple(sorted(problems, key=lambda problem: (problem.line, problem)))
        self.source = source
        super().__init__("\n".join(str(problem) for problem in self.problems))


class ContextError(FleetError):
    """A context cannot be read, or is not a good one."""

    exit_code = ExitCode.USAGE


@dataclass(frozen=True)
class CallSite:
    """Where a user function was called: names the agent, the state and, once known, the extractor."""

    function: str
    agent: str = ""
    state: str = ""
    extractor: str = ""

    def __str__(self) -> str:
        parts = [self.function]
        parts += [
            f"{name} {value}"
            for name, value in (("extractor", self.extractor), ("agent", self.agent), ("state", self.state))
            if value
        ]
        return ", ".join(parts)


class FunctionError(FleetError):
    """Map() or Eval() raised, hung, or answered something that is not an SSV or an evaluation."""

    exit_code = ExitCode.PERMANENT

    def __init__(self, message: str, site: CallSite) -> None:
        self.message = message
        self.site = site
        super().__init__(f"{site}: {message}")

    def __reduce__(self) -> tuple[type[FunctionError], tuple[str, CallSite]]:
        """Pickle what the error was made of: it may be raised in a worker process."""
        return FunctionError, (self.message, self.site)


class ModelError(FleetError):
    """An SA model cannot be loaded, or does not fit the SSV or the actions."""

    exit_code = ExitCode.PERMANENT


class StorageError(FleetError):
    """The storage refused an operation."""


class ObjectNotFound(StorageError):
    """No object has this path."""


class StorageFull(StorageError):
    """No space, or a quota, is left; what was acknowledged before is safe."""


class StorageReadOnly(StorageError):
    """The storage may not be written by this process."""


class StorageUnavailable(StorageError):
    """The storage does not answer now; trying again may help."""


class DriverError(FleetError):
    """The action driver refused a command, or cannot be reached."""


class TrainingError(FleetError):
    """Reward shaping or training cannot go on."""

    exit_code = ExitCode.PERMANENT


class MissionError(FleetError):
    """A mission cannot be planned, flown or evaluated."""

    exit_code = ExitCode.PERMANENT

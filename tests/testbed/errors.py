"""What can go wrong in the test bed."""

from __future__ import annotations


class BedError(Exception):
    """Something of the test bed cannot be made or does not work; the message says what to do."""


class Missing(BedError):
    """Something that the test bed is made of is not on this computer."""


class NotReady(BedError):
    """Something did not become ready in time, or ended before it was."""


class CommandFailed(BedError):
    """A command of the test bed ended with an error."""

    def __init__(self, command: list[str], code: int, stdout: str, stderr: str) -> None:
        said = (stderr.strip() or stdout.strip() or "it said nothing")[-4000:]
        super().__init__(f"{' '.join(command)[:500]} (exit code {code}): {said}")
        self.command, self.code, self.stdout, self.stderr = command, code, stdout, stderr

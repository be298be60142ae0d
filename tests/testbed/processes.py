"""Programs that the test bed runs: they end with it, even when it is killed, and write a log."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from signal import SIGKILL, SIGTERM, Signals

from tests.testbed.errors import CommandFailed, NotReady
from tests.testbed.waiting import wait_for

LOG_TAIL = 2000


class Program:
    """One process that can be started again; it is killed when the *thread* that started it ends."""

    def __init__(self, command: Sequence[str | Path], log: Path, env: Mapping[str, str] | None = None) -> None:
        self.command = [str(part) for part in command]
        self.log = log
        self._env = dict(env or {})
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def name(self) -> str:
        """The program's own name."""
        return Path(self.command[0]).name

    @property
    def pid(self) -> int:
        """Its process id; 0 when it does not run."""
        return self._process.pid if self._process is not None and self.running else 0

    @property
    def running(self) -> bool:
        """Whether it runs."""
        return self._process is not None and self._process.poll() is None

    def start(self) -> None:
        """Start it; its log goes on where it was."""
        if self.running:
            return
        # setpriv and not preexec_fn: that is not safe in a process with threads.
        dies_with_us = ["setpriv", "--pdeathsig", "KILL", *self.command]
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                dies_with_us,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=os.environ | self._env,
                start_new_session=True,  # a Ctrl-C at the terminal is for us, not for it
            )

    def wait_ready(self, ready: Callable[[], bool], timeout_s: float = 60.0) -> None:
        """Wait until `ready` says so.

        Raises:
            NotReady: it ended, or was not ready in time; the message has the end of its log.
        """

        def look() -> bool:
            if not self.running:
                raise NotReady(f"{self.name} ended; {self._tail()}")
            return ready()

        try:
            wait_for(self.name, look, timeout_s)
        except NotReady as error:
            raise NotReady(f"{error}; {self._tail()}") from error

    def stop(self, timeout_s: float = 5.0) -> None:
        """End it: SIGTERM, and SIGKILL when that was not heard in time."""
        self._end(SIGTERM, timeout_s)

    def kill(self) -> None:
        """End it at once, as a power cut would."""
        self._end(SIGKILL, 10.0)

    def signal(self, number: Signals) -> None:
        """Send it a signal: SIGSTOP and SIGCONT make it a hung one."""
        if self._process is not None:
            self._process.send_signal(number)

    def _end(self, number: Signals, timeout_s: float) -> None:
        if self._process is None:
            return
        if self._process.poll() is None:
            self._process.send_signal(number)
            try:
                self._process.wait(timeout_s)
            except subprocess.TimeoutExpired:
                self._process.kill()
        self._process.wait()
        self._process = None

    def _tail(self) -> str:
        text = self.log.read_text(errors="replace")[-LOG_TAIL:] if self.log.exists() else ""
        return f"the end of {self.log}:\n{text}"


def run(
    command: Sequence[str | Path],
    *,
    stdin: str | None = None,
    timeout_s: float = 120.0,
    env: Mapping[str, str] | None = None,
) -> str:
    """What a short command prints; `env` is added to the environment.

    Raises:
        CommandFailed: it failed; the message has what it said.
    """
    parts = [str(part) for part in command]
    environment = os.environ | dict(env or {})
    done = subprocess.run(
        parts, input=stdin, text=True, capture_output=True, timeout=timeout_s, check=False, env=environment
    )
    if done.returncode:
        raise CommandFailed(parts, done.returncode, done.stdout, done.stderr)
    return done.stdout

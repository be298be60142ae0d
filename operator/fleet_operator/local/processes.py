"""The only door to operating-system processes: start a container's command, see its end, stop it and its children.

No process outlives the runner, even when the runner is killed: `launch.py` ties the first process of a container to
it, `reaper.py` ends the rest of the process group. Processes are known by their id, and a process id is used for
signals only as long as the process has not been waited for, so it cannot have become another's.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

_HERE = Path(__file__).parent
_PYTHON = (sys.executable, "-I", "-S")


class Process:
    """A running command and all that it started; made by `Nursery.start`."""

    def __init__(self, popen: subprocess.Popen[bytes], nursery: Nursery) -> None:
        self._popen = popen
        self._nursery = nursery

    @property
    def pid(self) -> int:
        """Id of the process, and of its process group."""
        return self._popen.pid

    def poll(self) -> int | None:
        """The exit code once the process has ended, as a shell gives it: 137 for SIGKILL.

        The rest of its process group is killed, as that of a container is.
        """
        if self._popen.returncode is None:
            flags = os.WEXITED | os.WNOHANG | os.WNOWAIT
            if os.waitid(os.P_PID, self.pid, flags) is None:
                return None
            self._signal_group(signal.SIGKILL)  # not waited for yet: the id is still this group's
            self._popen.wait()
            self._nursery.ended(self.pid)
        code = self._popen.returncode
        return 128 - code if code < 0 else code

    def terminate(self) -> None:
        """Ask the process to end, as Kubernetes does: SIGTERM to the container's first process."""
        if self.poll() is None:
            os.kill(self.pid, signal.SIGTERM)

    def kill(self) -> None:
        """End the process and all that it started at once."""
        if self.poll() is None:
            self._signal_group(signal.SIGKILL)

    def _signal_group(self, number: signal.Signals) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, number)


class Nursery:
    """Starts processes that do not outlive this one; call it from the thread that lives longest."""

    def __init__(self) -> None:
        self._reaper = subprocess.Popen(
            [*_PYTHON, str(_HERE / "reaper.py")], stdin=subprocess.PIPE, start_new_session=True, env={}
        )

    def __enter__(self) -> Nursery:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def start(self, command: Sequence[str], environment: Mapping[str, str], folder: Path, log: Path) -> Process:
        """Start a command in a process group of its own; what it prints is added to `log`."""
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("ab") as output:
            popen = subprocess.Popen(
                [*_PYTHON, str(_HERE / "launch.py"), str(os.getpid()), *command],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=dict(environment),
                cwd=folder,
                start_new_session=True,
            )
        self._tell(f"+{popen.pid}\n")
        return Process(popen, self)

    def ended(self, pid: int) -> None:
        """A process group is over."""
        self._tell(f"-{pid}\n")

    def close(self) -> None:
        """End the reaper, which kills every group that is left."""
        if self._reaper.stdin is not None and not self._reaper.stdin.closed:
            with contextlib.suppress(BrokenPipeError):
                self._reaper.stdin.close()
        self._reaper.wait()

    def _tell(self, line: str) -> None:
        """A reaper that was killed is not missed: the processes are still tied to this one."""
        if self._reaper.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._reaper.stdin.write(line.encode())
                self._reaper.stdin.flush()

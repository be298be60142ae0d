"""First program of every container: ties its life to the runner's, then becomes the container's command.

Run as `python -I -S launch.py RUNNER_PID COMMAND...`; imports nothing of the project, so it costs milliseconds.
"""

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1
"""prctl(2): the signal that a process gets when its parent dies; kept over execve."""
_NOT_FOUND = 127


def main(arguments: list[str]) -> None:
    """Become the command, or end."""
    runner, command = int(arguments[0]), arguments[1:]
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != runner:  # the runner died before the line above
        os._exit(_NOT_FOUND)
    try:
        os.execvp(command[0], command)
    except OSError as error:
        sys.stderr.write(f"cannot start {command[0]}: {error.strerror}\n")
        os._exit(_NOT_FOUND)


if __name__ == "__main__":
    main(sys.argv[1:])

"""Ends what a runner that was killed left behind: the worker processes of its containers.

Run as `python -I -S reaper.py` with a pipe from the runner as its input: `+PID` says that a process group was made,
`-PID` that it is over. When the pipe closes, the runner is gone, and all groups that are left are killed.
"""

import os
import signal
import sys


def main() -> None:
    """Follow the runner until its end."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    groups: set[int] = set()
    for line in sys.stdin:
        if not line.endswith("\n"):
            break
        change = groups.add if line[0] == "+" else groups.discard
        change(int(line[1:]))
    for group in groups:
        try:
            os.killpg(group, signal.SIGKILL)
        except ProcessLookupError:
            continue


if __name__ == "__main__":
    main()

"""Starts stand-in roles by fork: an interpreter with everything imported costs half a second, a fork milliseconds."""

from __future__ import annotations

import ctypes
import gc
import importlib
import os
import signal
import sys
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from fleet_operator.local.processes import Nursery, Process
from tests import stand_in_roles

_PR_SET_PDEATHSIG = 1
_HIGHEST_FILE = 1024
_IMPORTED_LATE = "fleet.storage.hdfs"
"""What roles import only when they need it; a fourth of a second in each of them."""
_LIBC = ctypes.CDLL(None)  # opened before any fork


class Fork(Process):
    """A stand-in role in a process of its own."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._code: int | None = None

    @property
    def pid(self) -> int:
        return self._pid

    def poll(self) -> int | None:
        if self._code is None:
            if os.waitid(os.P_PID, self._pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
                return None
            self._signal_group(signal.SIGKILL)  # not waited for yet: the id is still this group's
            code = os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1])
            self._code = 128 - code if code < 0 else code
        return self._code


class StandIns(Nursery):
    """A nursery in which the platform's roles and the user's functions are those of `tests/stand_in_roles.py`.

    It must live in a process of one thread, as forks of others are not safe.
    """

    def __init__(self) -> None:
        super().__init__()
        importlib.import_module(_IMPORTED_LATE)
        gc.freeze()  # what is there now is not looked through, and so not copied, in each fork

    def start(self, command: Sequence[str], environment: Mapping[str, str], folder: Path, log: Path) -> Process:
        arguments = role_of(command)
        if arguments is None:
            return super().start(command, environment, folder, log)
        log.parent.mkdir(parents=True, exist_ok=True)
        sys.stdout.flush()
        runner = os.getpid()
        pid = os.fork()
        if pid == 0:
            _become(arguments, environment, folder, log, runner)
        return Fork(pid)


class Nurseries:
    """Starts the processes of a pod as its image asks for.

    Args:
        roles: stand-in or real; a pod whose image is `real/...` has the real ones in any case.
    """

    def __init__(self, roles: str) -> None:
        self._real = Nursery()
        self._usual = StandIns() if roles == "stand-in" else self._real

    def of(self, pod: Mapping[str, Any]) -> Nursery:
        """What starts the containers of a pod."""
        is_real = pod["spec"]["containers"][0]["image"].startswith("real/")
        return self._real if is_real else self._usual

    def close(self) -> None:
        """End what is left."""
        self._usual.close()
        self._real.close()


def role_of(command: Sequence[str]) -> list[str] | None:
    """The stand-in's arguments for a command of the platform; None when it is another's."""
    words = list(command[1:])
    if words[:2] == ["-m", "fleet.runtime"]:
        return words[2:]
    if words[:1] == ["-c"] and words[2:3] == ["serve"]:  # how `fleet serve` is started on this machine
        return words[2:]
    return None


def _become(arguments: list[str], environment: Mapping[str, str], folder: Path, log: Path, runner: int) -> NoReturn:
    """In the child: leave everything of the parent behind, and run the role."""
    code = 1
    try:
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != runner:
            os._exit(127)
        signal.set_wakeup_fd(-1)
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGCHLD):
            signal.signal(number, signal.SIG_DFL)
        os.setsid()
        _redirect(log)
        os.environ.clear()
        os.environ.update(environment)
        os.chdir(folder)
        stand_in_roles.main(arguments)
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
        if isinstance(end.code, str):
            sys.stderr.write(end.code)
    except BaseException:  # noqa: BLE001 - whatever it is, the child must end here and not go on as its parent
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _redirect(log: Path) -> None:
    output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for source, target in ((nothing, 0), (output, 1), (output, 2)):
        os.dup2(source, target)
    os.closerange(3, _HIGHEST_FILE)

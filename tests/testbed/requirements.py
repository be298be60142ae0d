"""What a test needs from this computer: without it the test is skipped, or fails where it must run (`.ci/run`)."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from typing import NoReturn

import pytest

from tests.testbed import packages
from tests.testbed.binaries import HADOOP, OWN, hadoop_jars, is_there, tool
from tests.testbed.cgroups import hierarchies
from tests.testbed.errors import BedError, CommandFailed, Missing
from tests.testbed.processes import run

OTHER_CLUSTER = "set FLEET_TEST_CLUSTER=kubeconfig and KUBECONFIG to run what needs no machines of our own elsewhere"


def required() -> bool:
    """Whether a test that cannot run is a failure."""
    return os.environ.get("FLEET_TESTBED") == "required"


def switched_off() -> bool:
    """Whether the tests that need programs of the test bed are left out: they take a quarter of an hour to build."""
    return os.environ.get("FLEET_TESTBED") == "off"


def refuse(reason: str) -> NoReturn:
    """Skip the test, or fail it where the test bed is required."""
    if required():
        pytest.fail(f"FLEET_TESTBED=required, but {reason}")
    pytest.skip(reason)


def need(*things: str) -> None:
    """Skip the test unless each thing is there; where the test bed is required, make what is missing, or fail.

    Making takes minutes, so that a test that somebody runs alone never starts it by itself.

    Args:
        things: "machines" (namespaces, control groups and what runs in machines), "hadoop" (jars and Java), a program
            that the test bed builds, or any other program on the PATH.
    """
    if switched_off():
        pytest.skip("FLEET_TESTBED=off: unset it to run what needs a real cluster, HDFS or images")
    for thing in things:
        try:
            CHECKS.get(thing, lambda thing=thing: _program(thing))()
        except BedError as error:
            refuse(str(error))


def check_machines() -> None:
    """That this computer can have machines.

    Raises:
        BedError: it cannot; the message says what to do.
    """
    if os.geteuid() != 0:
        raise Missing(f"machines need root: run as root, or {OTHER_CLUSTER}")
    packages.check(packages.MACHINES)
    hierarchies()
    try:
        run(["unshare", "--fork", "--pid", "--mount", "--uts", "--ipc", "--cgroup", "--net", "--mount-proc", "true"])
    except CommandFailed as error:
        raise Missing(
            f"namespaces cannot be made here ({error}): run outside of a container, or {OTHER_CLUSTER}"
        ) from error


def _machines() -> None:
    if required():
        packages.ensure(packages.MACHINES)
    check_machines()


def _hadoop() -> None:
    if required():
        packages.ensure(packages.HADOOP)
    packages.check(packages.HADOOP)
    _made(HADOOP)
    hadoop_jars()


def _program(name: str) -> None:
    if name in OWN:
        _made(name)
        tool(name)
    elif shutil.which(name, path=f"{os.environ.get('PATH', '')}:{packages.SYSTEM_PATH}") is None:
        raise Missing(f"{name} is not on the PATH: install it")


def _made(name: str) -> None:
    if not required() and not is_there(name):
        raise Missing(f"{name} is not built yet: run `make testbed` (once, some minutes), or set FLEET_TESTBED_BIN")


CHECKS: dict[str, Callable[[], None]] = {"machines": _machines, HADOOP: _hadoop}

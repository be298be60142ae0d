"""Debian packages that the test bed uses beside what it builds."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Mapping
from pathlib import Path

from tests.testbed.errors import CommandFailed, Missing
from tests.testbed.processes import run
from tests.testbed.progress import say

# A file or program of each package, which says whether it is there.
MACHINES = {
    "runc": "runc",
    "containernetworking-plugins": "/usr/lib/cni/bridge",
    "nftables": "nft",
    "iproute2": "ip",
    "conntrack": "conntrack",
    "busybox-static": "busybox",
    "procps": "sysctl",
    "openssl": "openssl",
}
HADOOP = {"openjdk-17-jre-headless": "java"}
MAVEN = {"maven": "mvn"}
LOCK = Path("/run/fleet-testbed-packages.lock")
SYSTEM_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


def ensure(packages: Mapping[str, str]) -> None:
    """Install the packages that are not there, when we may.

    Raises:
        Missing: some are not there and cannot be installed; the message has the command that does it.
    """
    if os.geteuid() != 0 or shutil.which("apt-get") is None:
        check(packages)
    if not _missing(packages):
        return
    with LOCK.open("w") as lock:  # apt-get does not wait for another one
        fcntl.flock(lock, fcntl.LOCK_EX)
        _install(_missing(packages))


def check(packages: Mapping[str, str]) -> None:
    """That the packages are there.

    Raises:
        Missing: some are not; the message has the command that installs them.
    """
    names = " ".join(_missing(packages))
    if names:
        raise Missing(f"missing: {names}; as root on Debian or Ubuntu: apt-get install --no-install-recommends {names}")


def _install(names: list[str]) -> None:
    if not names:
        return
    say(f"installing {', '.join(names)}")
    quiet = {"DEBIAN_FRONTEND": "noninteractive"}
    try:
        run(["apt-get", "update", "-qq"], timeout_s=600.0, env=quiet)
        run(["apt-get", "install", "-y", "-qq", "--no-install-recommends", *names], timeout_s=1200.0, env=quiet)
    except CommandFailed as error:
        raise Missing(f"{', '.join(names)} could not be installed: {error}") from error


def _missing(packages: Mapping[str, str]) -> list[str]:
    return [name for name, sign in packages.items() if not _there(sign)]


def _there(sign: str) -> bool:
    return Path(sign).exists() if sign.startswith("/") else shutil.which(sign, path=SYSTEM_PATH) is not None

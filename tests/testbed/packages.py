"""Debian packages that the test bed uses beside what it builds."""

from __future__ import annotations

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
SYSTEM_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


def ensure(packages: Mapping[str, str]) -> None:
    """Install the packages that are not there, when we may.

    Raises:
        Missing: some are not there and cannot be installed; the message has the command that does it.
    """
    missing = [name for name, sign in packages.items() if not _there(sign)]
    if not missing:
        return
    command = f"apt-get install --no-install-recommends {' '.join(missing)}"
    if os.geteuid() != 0 or shutil.which("apt-get") is None:
        raise Missing(f"missing: {', '.join(missing)}; as root on Debian or Ubuntu: {command}")
    say(f"installing {', '.join(missing)}")
    quiet = {"DEBIAN_FRONTEND": "noninteractive"}
    try:
        run(["apt-get", "update", "-qq"], timeout_s=600.0, env=quiet)
        run([*command.replace("install", "install -y -qq", 1).split()], timeout_s=1200.0, env=quiet)
    except CommandFailed as error:
        raise Missing(f"{', '.join(missing)} could not be installed: {error}") from error


def _there(sign: str) -> bool:
    return Path(sign).exists() if sign.startswith("/") else shutil.which(sign, path=SYSTEM_PATH) is not None

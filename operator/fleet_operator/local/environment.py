"""What is different on one machine, and nothing else: addresses, folders, and where programs are.

In a pod of the cluster                      here
0.0.0.0 as an address to listen on           the pod's own loopback address
a Service's host name, localhost:PORT        the loopback address of the pod behind it
paths below a mounted volume                 the volume's folder in the folder of the run
`python`, `fleet` of the image               those of this interpreter
"""

from __future__ import annotations

import os
import re
import site
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import fleet
from fleet_operator.local.workloads import Container, UnsupportedManifest

_EVERYWHERE = "0.0.0.0"
_PASSED_ON = ("LD_LIBRARY_PATH", "NUMBA_CACHE_DIR")
_FLEET = "from fleet.cli.main import run; run()"


@dataclass(frozen=True)
class Place:
    """Where a pod is on this machine.

    Args:
        address: Its loopback address.
        hosts: Addresses of the pods behind Services, by every host name.
        folders: Folder of each volume.
        ports: Ports of all containers of the pod.
    """

    address: str
    hosts: Mapping[str, str]
    folders: Mapping[str, Path]
    ports: frozenset[int]

    def environment(self, container: Container) -> dict[str, str]:
        """The variables of a container: those of the image, then those of the manifest."""
        given = {name: self.localised(value, container) for name, value in container.environment.items()}
        path = [given["PYTHONPATH"]] if "PYTHONPATH" in given else []
        path += _source_folders()
        return {**_image_environment(), **given, **({"PYTHONPATH": os.pathsep.join(path)} if path else {})}

    def localised(self, value: str, container: Container) -> str:
        """A value of the manifest as it is on this machine."""
        if value == _EVERYWHERE:
            return self.address
        for mount in sorted(container.mounts, key=len, reverse=True):
            if value == mount or value.startswith(f"{mount}/"):
                return f"{self.folders[container.mounts[mount]].absolute()}{value[len(mount) :]}"
        for port in self.ports:
            value = re.sub(rf"(?<![\w.-])localhost(?=:{port}(?!\d))", self.address, value)
        for host in sorted(self.hosts, key=len, reverse=True):
            value = re.sub(rf"(?<![\w.-]){re.escape(host)}(?![\w.-])", self.hosts[host], value)
        return value

    def folder(self, container: Container) -> Path:
        """The working folder of a container."""
        wanted = self.localised(container.working_folder, container) if container.working_folder else ""
        return Path(wanted) if wanted else next((self.folders[name] for name in container.mounts.values()), Path.cwd())


def check_command(container: Container) -> None:
    """Refuse a container whose program is known only to its image.

    Raises:
        UnsupportedManifest: says what to write in the FleetSpec.
    """
    if not container.command:
        raise UnsupportedManifest(
            f"the image {container.image} of {container.name} cannot be run on this machine without a container "
            f"runtime; write its program in spec.{container.name}.command, or name a Python function"
        )


def command_of(container: Container, environment: Mapping[str, str]) -> tuple[str, ...]:
    """The command of a container on this machine, with $(NAME) filled in as Kubernetes does."""
    filled = [_expanded(word, environment) for word in container.command]
    return (*_program(filled[0]), *filled[1:])


def _expanded(word: str, environment: Mapping[str, str]) -> str:
    """Kubernetes' own rule: $(NAME) is the variable's value, $$(NAME) is $(NAME), others stay."""

    def value(match: re.Match[str]) -> str:
        if match[0].startswith("$$"):
            return match[0][1:]
        return environment.get(match[1], match[0])

    return re.sub(r"\$?\$\(([A-Za-z_][A-Za-z0-9_.-]*)\)", value, word)


def _program(name: str) -> tuple[str, ...]:
    match name:
        case "python" | "python3":
            return (sys.executable,)
        case "fleet":
            return (sys.executable, "-c", _FLEET)
        case _:
            return (name,)


def _image_environment() -> dict[str, str]:
    """What the image brings: nothing of the user's shell but where programs and libraries are."""
    folders = [str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)]
    passed_on = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
    return {"PATH": os.pathsep.join(folders), "LANG": "C.UTF-8", **passed_on}


def _source_folders() -> Sequence[str]:
    """Where the library is, when it runs from its sources and is not installed."""
    folder = Path(fleet.__file__).resolve().parent.parent
    installed = {Path(each).resolve() for each in site.getsitepackages()}
    return [] if folder in installed else [str(folder)]

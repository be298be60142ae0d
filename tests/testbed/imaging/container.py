"""A container of an image without a cluster: its programs in a chroot, as its user, on this computer's network."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from tests.testbed.imaging.buildah import Buildah
from tests.testbed.processes import Program

USER = "65532:65532"
CONTAINERS = "tried-"
"""How the names of containers begin, so that nobody takes them for leftovers of a build."""


class Container:
    """Programs of one image, one after another or side by side, over the same root folder.

    Args:
        store: Where the image is.
        name: The container.
        root: Its root folder on this computer.
        mounts: Folders of this computer, by the path where programs see them.
    """

    def __init__(self, store: Buildah, name: str, root: Path, mounts: Mapping[str, Path]) -> None:
        self.root = root
        self._store, self._name, self._mounts = store, name, mounts

    def run(self, *command: str, env: Mapping[str, str] | None = None) -> subprocess.CompletedProcess[str]:
        """Run a program to its end, whatever its exit code is; the last lines of stderr are buildah's."""
        return subprocess.run(
            self._command(command, env or {}),
            check=False,
            capture_output=True,
            text=True,
            env=self._store.environment,
            timeout=120.0,
        )

    def start(self, *command: str, log: Path) -> Program:
        """Start a program that goes on until it is stopped."""
        program = Program(self._command(command, {}), log, self._store.environment)
        program.start()
        return program

    def _command(self, command: tuple[str, ...], env: Mapping[str, str]) -> list[str]:
        options = ["--user", USER, "--hostname", "localhost"]  # a name that Hadoop can look up
        options += [word for key, value in env.items() for word in ("--env", f"{key}={value}")]
        options += [word for path, folder in self._mounts.items() for word in ("--volume", f"{folder}:{path}")]
        return self._store.command("run", "--isolation", "chroot", *options, self._name, "--", *command)


@contextmanager
def container(store: Buildah, image: str, mounts: Mapping[str, Path] | None = None) -> Iterator[Container]:
    """A container of an image in a store; removed at the end.

    Args:
        store: Where the image is.
        image: Its name there.
        mounts: Folders of this computer, by the path where the container's programs see them.
    """
    with store.in_use():
        name = store.run("from", "--pull=never", "--name", f"{CONTAINERS}{uuid4().hex}", image).strip()
        try:
            yield Container(store, name, Path(store.run("mount", name).strip()), mounts or {})
        finally:
            store.run("rm", name)
